"""Times Stone Soup at what `cargo bench -p foveate-tests --bench large_scale -- speed` times, and then runs that, in one go.

pip install numpy stonesoup
python3 tests/benches/peer_tracking.py

Both: one thread, features given directly, no camera or network. 6 cameras at 60 Hz that nobody synchronised, 8 targets,
0.5 px of noise at 420 px focal length, one update for each observation of each frame. Stone Soup starts with the targets
known; ours has to find them.
"""

import os
import subprocess
import sys
import time
import warnings
from datetime import datetime, timedelta

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
warnings.filterwarnings("ignore")

import numpy as np
import stonesoup
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment, NearestNeighbour
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.measures import Mahalanobis
from stonesoup.models.measurement.nonlinear import CartesianToElevationBearing
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState, StateVector
from stonesoup.types.track import Track
from stonesoup.updater.kalman import ExtendedKalmanUpdater

TARGETS, CAMERAS, RATE, SECONDS = 8, 6, 60, 0.5
SIGMA = 0.5 / 420
START = datetime(2002, 6, 1)


def truth(target, seconds):
    """Where a target is: all on one ring around the room, up and down [m]."""
    angle = 0.8 * seconds + target * 2 * np.pi / TARGETS
    return np.array([1.2 * np.cos(angle), 1.6 * np.sin(angle), 1.2 + 0.3 * np.sin(2 * angle)])


def state(target):
    """A target at the start, with its velocity."""
    place = truth(target, 0)
    speed = (truth(target, 1e-4) - place) / 1e-4
    vector = StateVector([value for pair in zip(place, speed) for value in pair])
    return GaussianState(vector, np.diag([0.01**2, 0.5**2] * 3), timestamp=START - timedelta(milliseconds=1))


def frames(random):
    """Time and detections of each frame, in the order of capture."""
    angles = 2 * np.pi * np.arange(CAMERAS) / CAMERAS
    noise = np.diag([SIGMA**2, SIGMA**2])
    models = [
        CartesianToElevationBearing(
            ndim_state=6, mapping=(0, 2, 4), noise_covar=noise,
            translation_offset=np.array([[2.6 * np.cos(angle)], [3.4 * np.sin(angle)], [2.7]]),
        )
        for angle in angles
    ]
    offsets = random.uniform(0, 1 / RATE, CAMERAS)
    times = sorted((offsets[c] + k / RATE, c) for c in range(CAMERAS) for k in range(int(SECONDS * RATE)))
    found = []
    for seconds, camera in times:
        stamp = START + timedelta(seconds=seconds)
        detections = set()
        for target in range(TARGETS):
            x, y, z = truth(target, seconds)
            seen = models[camera].function(GaussianState(StateVector([x, 0, y, 0, z, 0]), np.eye(6)), noise=True)
            detections.add(Detection(seen, timestamp=stamp, measurement_model=models[camera]))
        found.append((seconds, stamp, detections))
    return found


def run(associator, seen):
    """Observations a second, and the mean error at the end [mm]."""
    predictor = KalmanPredictor(CombinedLinearGaussianTransitionModel([ConstantVelocity(1.0)] * 3))
    updater = ExtendedKalmanUpdater(None)
    association = associator(DistanceHypothesiser(predictor, updater, measure=Mahalanobis(), missed_distance=5))
    tracks = [Track([state(target)]) for target in range(TARGETS)]
    start = time.process_time()
    for _, stamp, detections in seen:
        hypotheses = association.associate(set(tracks), detections, stamp)
        for track in tracks:
            hypothesis = hypotheses[track]
            track.append(updater.update(hypothesis) if hypothesis else hypothesis.prediction)
    spent = time.process_time() - start
    end = seen[-1][0]
    places = [np.ravel(track.state_vector)[[0, 2, 4]].astype(float) for track in tracks]
    errors = [np.linalg.norm(place - truth(target, end)) for target, place in enumerate(places)]
    return len(seen) * TARGETS / spent, 1e3 * float(np.mean(errors))


def main():
    np.random.seed(20020601)
    seen = frames(np.random.default_rng(20020601))
    print(f"Stone Soup {stonesoup.__version__}, in one thread, {CAMERAS} cameras x {TARGETS} targets")
    for associator in (NearestNeighbour, GNNWith2DAssignment):
        rate, error = run(associator, seen)
        print(f"  {associator.__name__}: {rate:.0f} observations/s, {error:.1f} mm at the end", flush=True)
    command = ["cargo", "bench", "-q", "-p", "foveate-tests", "--bench", "large_scale", "--", "speed"]
    print("ours, in one thread:", flush=True)
    sys.exit(subprocess.run(command).returncode)


if __name__ == "__main__":
    main()
