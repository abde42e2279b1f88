"""Reads the console of the virtual machine and says whether the cameras did as they must."""

import csv
import json
import sys

text = open(sys.argv[1], errors="replace").read()
failures = []


def check(holds, what):
    print(("ok    " if holds else "WRONG ") + what)
    if not holds:
        failures.append(what)


def part(name):
    begin, end = f"VIVID begin {name}\n", f"VIVID end {name}\n"
    if begin not in text or end not in text:
        check(False, f"the machine printed `{name}`")
        return ""
    return text.split(begin)[1].split(end)[0]


def run(name):
    words = part(name)
    end = words.index("\n}\n") + 2
    figures = json.loads(words[: end + 1])
    return figures.get("figures", figures), words[end:]


devices = part("devices")
for word in ["/dev/video0", "/dev/video1", "vivid", "`", "GREY", "YUYV", "320 x 180 px", "Brightness: 0 to 255", "Test Pattern: 0 `75% Colorbar`"]:
    check(word in devices, f"`foveate devices` names {word}")

refused = part("refused")
sentence = next((it for it in refused.splitlines() if it.startswith("error")), "")
check("code 2" in refused and "26.5 Hz" in sentence and "25, 30" in sentence, f"a rate that is not offered is refused: {sentence}")

figures, words = run("quiet")
print({name: value for name, value in figures.items() if name.startswith("v4l.")})
check("VIVID quiet 0" in text, "the quiet run ended well")
check("VIVID now     Brightness: 0 to 255, default 128, now 77" in text, "the control has the value that the rig says")
for camera in ["gray", "color"]:
    frames, rate = figures[f"v4l.frames.{camera}"], figures[f"v4l.rate_hz.{camera}"]
    gaps, latency = figures[f"v4l.gaps.{camera}"], figures[f"v4l.latency_ms.mean.{camera}"]
    check(frames >= 30, f"{camera}: {frames} frames in 6 s")
    check(abs(frames + gaps - 150) <= 12, f"{camera}: frames and gaps together, {frames} + {gaps}, fill 6 s at 25 Hz")
    check(rate <= 25.5, f"{camera}: rate {rate:.2f} Hz")
    check(-50 <= latency < 500, f"{camera}: {latency:.1f} ms from stamp to arrival")
    check(abs(figures[f"v4l.drift_ppm.{camera}"]) < 50000, f"{camera}: drift {figures[f'v4l.drift_ppm.{camera}']:.0f} ppm")
    check(figures[f"v4l.restarts.{camera}"] == 0, f"{camera}: never started again")

figures, words = run("faults")
print(words)
print({name: value for name, value in figures.items() if name.startswith("v4l.")})
check("VIVID faults 0" in text, "the run with faults ended well")
for pressed in ["damage", "drop", "fatal", "disconnect"]:
    check(f"VIVID pressed {pressed}" in text, f"fault injected: {pressed}")
check("VIVID unplugged 0" in text and "VIVID plugged 2" in text, "the devices were away and came back")
check("is marked as damaged by the driver" in words, "the damaged buffer is a gap with its reason")
check(figures["v4l.lost_by_driver.gray"] >= 5, f"dropped frames are gaps: {figures['v4l.lost_by_driver.gray']}")
check("the driver lost this frame" in words, "with their reason")
check("the driver reports" in words, "the broken stream is a gap with its reason")
check("the camera is gone" in words, "the camera that disappeared is a gap with its reason")
check(figures["v4l.reopenings.gray"] >= 2, f"gray was opened again {figures['v4l.reopenings.gray']} times")
check(figures["v4l.reopenings.color"] == 1, f"color was opened again {figures['v4l.reopenings.color']} times")
for camera in ["gray", "color"]:
    total = figures[f"v4l.frames.{camera}"] + figures[f"v4l.gaps.{camera}"]
    check(abs(total - 34 * 25) <= 34, f"{camera}: frames and gaps together, {total}, fill 34 s at 25 Hz")
check("VIVID jpeg" in text and "`MJPG`" in text, "a layout that is not offered is refused by name")

if failures:
    print(f"{len(failures)} checks failed")
    sys.exit(1)
print("the virtual cameras did as they must")
