"""Drives `foveate sim head` with two clients from PyPI, each of their methods: visca-over-ip 0.5.2 over UDP, pyvisca 0.1.9 over a pseudo terminal.

    python3 drive.py target/release/foveate

Each call is judged by what the head says when it is asked afterwards by a second controller that knows neither package, or by the error that the
client reports. A method that no row below calls is a fault, so that a new one of a later version is seen.
"""

import inspect
import re
import socket
import subprocess
import sys
import time

import pyvisca.visca
import serial
import visca_over_ip
from visca_over_ip.exceptions import ViscaException

SYNTAX, NOT_EXECUTABLE = 2, 0x41


class Head:
    """A head as a process of its own."""

    def __init__(self, program, *arguments):
        self.process = subprocess.Popen([program, "sim", "head", *arguments], stdout=subprocess.PIPE, text=True)
        self.words = self.process.stdout.readline()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        assert self.process.wait(10) == 0, "the head did not end in good order"


class Inquirer:
    """A controller of its own that asks, and reads what comes back."""

    def four(self, *code):
        """Four digits as an unsigned number."""
        return int("".join(f"{it:x}" for it in self.ask(*code)), 16)

    def position(self):
        digits = self.ask(0x06, 0x12)
        words = [int("".join(f"{it:x}" for it in half), 16) for half in (digits[:4], digits[4:])]
        return tuple(it - 0x10000 if it & 0x8000 else it for it in words)

    def zoom(self):
        return self.four(0x04, 0x47)

    def focus(self):
        return self.four(0x04, 0x48)

    def rest(self):
        """Waits until nothing moves; gives the position."""
        time.sleep(0.45)  # latency of a move
        last, same = None, 0
        for _ in range(400):
            now = (self.position(), self.zoom(), self.focus())
            same = same + 1 if now == last else 0
            if same == 3:
                return now[0]
            last = now
            time.sleep(0.03)
        raise AssertionError("the head never comes to rest")


class UdpInquirer(Inquirer):
    def __init__(self, address):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(5)
        self.socket.connect(address)
        self.number = 0

    def ask(self, *code):
        self.number += 1
        packet = bytes([0x81, 0x09, *code, 0xFF])
        self.socket.send(b"\x01\x10" + len(packet).to_bytes(2, "big") + self.number.to_bytes(4, "big") + packet)
        answer = self.socket.recv(64)
        assert answer[:2] == b"\x01\x11" and int.from_bytes(answer[4:8], "big") == self.number, answer.hex()
        assert answer[8:10] == b"\x90\x50", f"{packet.hex()}: {answer[8:].hex()}"
        return answer[10:-1]


class SerialInquirer(Inquirer):
    """On the line that the client uses: there is only one."""

    def __init__(self, port):
        self.port = port

    def packets(self, seconds):
        """What comes within a time."""
        end, found = time.monotonic() + seconds, b""
        while time.monotonic() < end:
            found += self.port.read_all()
            time.sleep(0.002)
        return [it + b"\xff" for it in found.split(b"\xff")[:-1]]

    def answer(self):
        """The first acknowledgement or refusal that comes; completions of what went before are passed over."""
        end, found = time.monotonic() + 5, b""
        while time.monotonic() < end:
            found += self.port.read_all()
            for packet in found.split(b"\xff")[:-1]:
                if packet[1] >> 4 in (4, 6):
                    return packet + b"\xff"
            time.sleep(0.002)
        raise AssertionError(f"no answer: {found.hex()}")

    def ask(self, *code):
        # The client empties the line before it asks, and what it empties may be this answer: ask again.
        for _ in range(10):
            self.port.reset_input_buffer()
            self.port.write(bytes([0x81, 0x09, *code, 0xFF]))
            end, found = time.monotonic() + 1, b""
            while time.monotonic() < end:
                found += self.port.read_all()
                for packet in found.split(b"\xff")[:-1]:
                    # Completions of what is still on its way are not what was asked for.
                    if packet[:2] == b"\x90\x50":
                        return packet[2:]
                time.sleep(0.002)
        raise AssertionError(f"no answer to {code}: {found.hex()}")


class Covered:
    """Calls methods of `of`, and knows which were called."""

    def __init__(self, of):
        self.of, self.called = of, set()

    def __getattr__(self, name):
        self.called.add(name)
        return getattr(self.of, name)

    def left_out(self):
        public = {name for name, _ in inspect.getmembers(type(self.of), callable) if not name.startswith("_")}
        return public - self.called


def equal(found, expected, what):
    assert found == expected, f"{what}: found {found}, expected {expected}"


def becomes(call, expected, what):
    """A client takes the first packet that comes for the answer, also where it completes an earlier command: it may ask until the line is quiet."""
    for _ in range(20):
        try:
            found = call()
        except (IndexError, ValueError) as error:
            found = error
        if found == expected:
            return
        time.sleep(0.1)
    equal(found, expected, what)


def refused(call, code, what):
    # The client waits for a tenth of a second only; on a busy machine an answer may come too late for it.
    for _ in range(10):
        try:
            call()
        except ViscaException as error:
            equal(error.status_code, code, what)
            return
    raise AssertionError(f"{what}: not refused")


def over_ip(program):
    # The client hears answers to inquiries at the head's own port, so that the head needs an address of its own.
    with Head(program, "--bind", "127.0.0.2", "--udp", "0") as head:
        host, port = re.search(r"UDP ([\d.]+):(\d+)", head.words).groups()
        asked = UdpInquirer((host, int(port)))
        one = lambda code: asked.ask(0x04, code)[0]
        level = lambda code: asked.four(0x04, code)
        camera = Covered(visca_over_ip.Camera(host, int(port)))

        # Where it looks: by position, relative, by drives of both axes and of one, by presets.
        camera.pantilt(24, 20, 200, -90)
        equal(asked.rest(), (200, -90), "absolute")
        equal(camera.get_pantilt_position(), (200, -90), "get_pantilt_position")
        camera.pantilt(24, 20, -50, 40, relative=True)
        equal(asked.rest(), (150, -50), "relative")
        for axis, (pan, tilt) in enumerate([(-10, 0), (0, 10)]):
            before = asked.position()
            camera.pantilt(pan, tilt)
            time.sleep(0.6)
            camera.pantilt(0, 0)
            after = asked.rest()
            assert after[1 - axis] == before[1 - axis] and after[axis] != before[axis], (before, after)
        camera.pantilt(10, -10)
        time.sleep(0.6)
        camera.pantilt(0, 0)
        asked.rest()
        camera.pantilt(24, 20, 300, 120)
        asked.rest()
        camera.zoom_to(0.03)
        equal(asked.rest(), (300, 120), "before the preset")
        equal((asked.zoom(), camera.get_zoom_position()), (492, 492), "zoom_to")
        camera.save_preset(2)
        camera.pantilt_home()
        camera.zoom_to(0)
        equal(asked.rest(), (0, 0), "pantilt_home")
        camera.recall_preset(2)
        equal((asked.rest(), asked.zoom()), ((300, 120), 492), "recall_preset")
        refused(lambda: camera.recall_preset(4), NOT_EXECUTABLE, "a preset that was never set")
        refused(lambda: camera.save_preset(6), SYNTAX, "a seventh preset")
        camera.pantilt_reset()
        equal(asked.rest(), (0, 0), "pantilt_reset")
        refused(lambda: camera.pantilt(24, 24, 100, 100), SYNTAX, "faster than the head tilts")
        refused(lambda: camera.zoom_to(1), SYNTAX, "longer than the head's lens")

        # Zoom and focus.
        for speed, moved in [(5, lambda a, b: b > a), (-7, lambda a, b: b < a)]:
            before = asked.zoom()
            camera.zoom(speed)
            time.sleep(0.3)
            camera.zoom(0)
            assert moved(before, asked.zoom()), (speed, before, asked.zoom())
        for mode, expected in [("auto", 2), ("manual", 3), ("auto/manual", 2), ("auto/manual", 3)]:
            camera.set_focus_mode(mode)
            equal(one(0x38), expected, f"set_focus_mode {mode}")
        equal(camera.get_focus_mode(), "manual", "get_focus_mode")
        camera.manual_focus(5)
        time.sleep(0.3)
        camera.manual_focus(0)
        near = asked.focus()
        assert near > 0x1000, near
        camera.manual_focus(-5)
        time.sleep(0.1)
        camera.manual_focus(0)
        assert 0x1000 <= asked.focus() < near
        camera.set_focus_mode("infinity")
        asked.rest()
        equal(asked.focus(), 0x1000, "infinity")
        camera.set_focus_mode("one push trigger")
        camera.set_focus_mode("auto")
        refused(lambda: camera.manual_focus(3), NOT_EXECUTABLE, "focus by hand while it focuses by itself")

        # What is remembered: a switch or a mode each.
        switches = [
            ("digital_zoom", 0x06), ("backlight", 0x33), ("slow_shutter", 0x5A), ("flip_horizontal", 0x61), ("flip_vertical", 0x66), ("defog", 0x37),
        ]
        for name, code in switches:
            for on in [True, False]:
                getattr(camera, name)(on)
                equal(one(code), 2 if on else 3, name)
        for low in [True, False]:
            camera.autofocus_sensitivity_low(low)
            equal(one(0x58), 3 if low else 2, "autofocus_sensitivity_low")
            camera.ir_correction(low)
            equal(one(0x11), int(low), "ir_correction")
        for horizontal, vertical, expected in [(True, True, 3), (False, True, 2), (True, False, 1), (False, False, 0)]:
            camera.flip(horizontal, vertical)
            equal(one(0xA4), expected, "flip")
        modes = [
            ("set_autofocus_mode", 0x57, [("interval", 1), ("zoom trigger", 2), ("normal", 0)]),
            ("white_balance_mode", 0x35, [("indoor", 1), ("outdoor", 2), ("one push", 3), ("auto tracing", 4), ("manual", 5), ("color temperature", 0x20), ("auto", 0)]),
            ("autoexposure_mode", 0x39, [("manual", 3), ("shutter priority", 0x0A), ("iris priority", 0x0B), ("bright", 0x0D), ("auto", 0)]),
        ]
        for name, code, values in modes:
            for word, expected in values:
                getattr(camera, name)(word)
                equal(one(code), expected, f"{name} {word}")
        camera.white_balance_mode("one push trigger")
        camera.set_color_gain("cyan", 7)
        equal(level(0x49), 0x57, "set_color_gain")

        # Levels by steps; the package's names for the temperature of the white balance send the bytes of the gain of red.
        for what, code in [("red_gain", 0x43), ("white_balance_temperature", 0x43), ("gain", 0x4C), ("shutter", 0x4A), ("iris", 0x4B), ("aperture", 0x42)]:
            getattr(camera, f"reset_{what}")()
            start = level(code)
            getattr(camera, f"increase_{what}")()
            equal(level(code), start + 1, f"increase_{what}")
            getattr(camera, f"decrease_{what}")()
            equal(level(code), start, f"decrease_{what}")
        for what, code in [("exposure_compensation", 0x4E), ("brightness", 0x4D)]:
            start = level(code)
            getattr(camera, f"increase_{what}")()
            equal(level(code), start + 1, f"increase_{what}")
            getattr(camera, f"decrease_{what}")()
            equal(level(code), start, f"decrease_{what}")
        camera.reset_blue_gain()
        start = level(0x44)
        camera.increase_blue_gain()
        equal(level(0x44), start + 1, "increase_blue_gain")
        red = level(0x43)
        camera.decrease_blue_gain()  # sends the bytes of the gain of red
        equal((level(0x44), level(0x43)), (start + 1, red - 1), "decrease_blue_gain")

        # What this version sends otherwise than any command list has it: a byte where two digits belong, or a code of no list.
        for name, arguments in [
            ("set_red_gain", [10]), ("set_blue_gain", [10]), ("set_white_balance_temperature", [10]), ("set_gain", [5]), ("set_shutter", [5]),
            ("set_iris", [5]), ("set_brightness", [5]), ("set_aperture", [5]), ("set_autofocus_interval", [5, 5]), ("info_display", [True]), ("info_display", [False]),
        ]:
            refused(lambda: getattr(camera, name)(*arguments), SYNTAX, name)

        # Power: this client says everything four times.
        camera.set_power(False)
        equal(one(0x00), 3, "set_power False")
        refused(lambda: camera.pantilt_home(), NOT_EXECUTABLE, "a move in standby")
        camera.set_power(True)
        equal(one(0x00), 2, "set_power True")
        time.sleep(3.5)
        camera.pantilt_home()
        camera.reset_sequence_number()
        camera.pantilt(10, 10, 10, 10)
        equal(asked.rest(), (10, 10), "after a reset of the numbers")
        camera.close_connection()
        equal(camera.left_out(), set(), "methods of Camera that nothing here calls")

        # The same with what the package remembers of the camera: it begins anew, with its numbers too.
        caching = visca_over_ip.CachingCamera(host, int(port))
        caching.pantilt(24, 20, -100, 60)
        equal(asked.rest(), (-100, 60), "CachingCamera.pantilt")
        caching.pantilt(-10, 0)
        time.sleep(0.6)
        caching.pantilt(0, 0)
        caching.pantilt(0, 0)
        assert asked.rest()[0] < -100
        caching.zoom(3)
        time.sleep(0.3)
        caching.zoom(0)
        assert asked.zoom() > 0
        equal(caching.get_focus_mode(), "auto", "CachingCamera.get_focus_mode")
        caching.set_focus_mode("manual")
        equal((one(0x38), caching.get_focus_mode()), (3, "manual"), "CachingCamera.set_focus_mode")
        caching.close_connection()
        n_missed = camera.num_missed_responses + caching.num_missed_responses
        assert n_missed < 50, f"{n_missed} answers did not come within a tenth of a second"
        return len(camera.called) + 4


def over_serial(program):
    with Head(program) as head:
        path = re.search(r"EVI-D30 at (\S+),", head.words).group(1)
        camera = Covered(pyvisca.visca.PTZ(path))
        asked = SerialInquirer(camera.of._output)
        one = lambda code: asked.ask(0x04, code)[0]
        level = lambda code: asked.four(0x04, code)

        def done(name, *arguments):
            """Calls a method, which the head acknowledges."""
            asked.packets(0.05)
            getattr(camera, name)(*arguments)
            answer = asked.answer()
            assert answer[1] >> 4 == 4, f"{name}{arguments}: {answer.hex()}"

        def answered(name, arguments, expected):
            asked.packets(0.05)
            getattr(camera, name)(*arguments)
            equal(asked.answer().hex(), expected, f"{name}{arguments}")

        # Where it looks.
        done("set_pan", 200, 20)
        equal(asked.rest(), (200, 0), "set_pan")
        done("set_tilt", 90, 20)
        equal(asked.rest(), (200, 90), "set_tilt")
        becomes(camera.get_pan, 200, "get_pan")
        becomes(camera.get_tilt, 90, "get_tilt")
        done("set_pan_rel", 50, 20)
        done("set_tilt_rel", 30, 20)
        assert asked.rest()[1] == 120
        done("relative_position", 10, 10, 30, 10)  # its speeds are decimal digits taken as hexadecimal ones
        asked.rest()
        before = asked.position()
        done("relative_position", 10, 10, 30, 10, -1, 1)
        after = asked.rest()
        assert after[0] < before[0] and after[1] == before[1] + 10, (before, after)
        done("home")
        equal(asked.rest(), (0, 0), "home")
        drives = [
            ("left", (-1, 0)), ("right", (1, 0)), ("up", (0, 1)), ("down", (0, -1)),
            ("left_up", (-1, 1)), ("right_up", (1, 1)), ("left_down", (-1, -1)), ("right_down", (1, -1)),
        ]
        for name, way in drives:
            before = asked.position()
            done(name)
            time.sleep(0.4)
            done("stop")
            after = asked.rest()
            moved = tuple((b > a) - (b < a) for a, b in zip(before, after))
            equal(moved, way, name)
        done("reset")
        equal(asked.rest(), (0, 0), "reset")
        done("set_pan", 111, 20)
        asked.rest()
        done("preset_set", 5)
        done("home")
        asked.rest()
        done("preset_recall", 5)
        equal(asked.rest(), (111, 0), "preset_recall")
        answered("preset_recall", [1], "906141ff")
        answered("preset_set", [200], "906002ff")
        done("set_pan", 800, 3)
        camera.cancel()  # sends IF_Clear: the move ends
        asked.packets(0.3)
        assert asked.rest()[0] < 700

        # Zoom and focus.
        done("set_zoom", 400)
        asked.rest()
        equal(asked.zoom(), 400, "set_zoom")
        becomes(camera.get_zoom, 400, "get_zoom")
        done("set_zoom_rel", -100)
        asked.rest()
        equal(asked.zoom(), 300, "set_zoom_rel")
        for name, more in [("zoom_in", True), ("zoom_out", False)]:
            before = asked.zoom()
            done(name)
            time.sleep(0.2)
            done("zoom_stop")
            assert (asked.zoom() > before) == more, name
        answered("focus_near", [], "906141ff")
        done("autofocus")
        camera.comm("8101043803FF")  # by hand; the package has no method for it
        asked.packets(0.1)
        for name, more in [("focus_near", True), ("focus_far", False)]:
            before = asked.focus()
            done(name)
            time.sleep(0.1)
            done("focus_stop")
            assert (asked.focus() > before) == more, name
        camera.command("8101043802FF")
        asked.packets(0.1)
        equal(one(0x38), 2, "command")

        # What is remembered.
        values = [
            ("autofocus_sens_low", [], 0x58, 3), ("autofocus_sens_high", [], 0x58, 2), ("backlight", [1], 0x33, 2), ("backlight", [0], 0x33, 3),
            ("exposure_full_auto", [], 0x39, 0), ("freeze", [1], 0x62, 2), ("freeze", [0], 0x62, 3), ("white_balance_indoor", [], 0x35, 1),
            ("white_balance_outdoor", [], 0x35, 2), ("white_balance_auto", [], 0x35, 0), ("wide_cinema", [], 0x60, 1), ("wide_169", [], 0x60, 2),
            ("wide_off", [], 0x60, 0),
        ]
        effects = ["off", "pastel", "negative", "sepia", "b_w", "solarize", "mosaic", "slim", "stretch"]
        values += [(f"picture_effect_{name}", [], 0x63, number) for number, name in enumerate(effects)]
        for name, arguments, code, expected in values:
            done(name, *arguments)
            equal(one(code), expected, f"{name}{arguments}")
        for what, code in [("aperture", 0x42), ("bright", 0x4D), ("gain", 0x4C), ("iris", 0x4B)]:
            done(f"{what}_reset")
            start = level(code)
            done(f"{what}_up")
            equal(level(code), start + 1, f"{what}_up")
            done(f"{what}_down")
            equal(level(code), start, f"{what}_down")

        # Power, and the package's own care of its port.
        done("power", 0)
        becomes(camera.get_power, 0, "power off")
        done("power", 1)
        becomes(camera.get_power, 1, "power on")
        time.sleep(3.5)
        becomes(lambda: camera.inq("81090002FF")[:4], "9050", "inq")
        camera.reset_input_buffer()
        camera.reset_port()
        asked.port = camera.of._output
        assert camera.close()
        assert camera.open()
        asked.port = camera.of._output
        assert isinstance(camera.read(), str)
        equal(camera.multi_replace("VV", {"VV": "15"}), "15", "multi_replace")
        done("home")
        equal(camera.left_out(), set(), "methods of PTZ that nothing here calls")
        camera.close()
        return len(camera.called)


def main():
    program = sys.argv[1]
    n_methods = over_ip(program)
    print(f"visca-over-ip: {n_methods} methods drive the head as they should")
    n_methods = over_serial(program)
    print(f"pyvisca (pyserial {serial.__version__}): {n_methods} methods drive the head as they should")


if __name__ == "__main__":
    main()
