"""What a message costs in MediaPipe through a chain of PassThroughCalculators: one packet in flight, median.

    python mediapipe_hop.py LENGTH SIZE COUNT

Calculators run on the calling thread (ApplicationThreadExecutor). Prints nanoseconds from adding the packet until the
graph is idle; the slope between two lengths cancels what Python costs. mediapipe 0.10.21: later wheels have no graphs.
"""

import statistics
import sys
import time

import mediapipe as mp


def chain(length):
    lines = ['input_stream: "s0"', f'output_stream: "s{length}"', 'executor { name: "" type: "ApplicationThreadExecutor" }']
    for index in range(length):
        lines.append(
            f'node {{ calculator: "PassThroughCalculator" input_stream: "s{index}" output_stream: "s{index + 1}" }}'
        )
    return "\n".join(lines)


def main():
    length, size, count = map(int, sys.argv[1:4])
    graph = mp.CalculatorGraph(graph_config=chain(length))
    arrived = []
    graph.observe_output_stream(f"s{length}", lambda _stream, packet: arrived.append(packet.timestamp.value))
    graph.start_run()
    packet = mp.packet_creator.create_string(b"\x07" * size)
    took = []
    for index in range(count):
        stamped = packet.at(index)
        start = time.perf_counter_ns()
        graph.add_packet_to_input_stream("s0", stamped)
        graph.wait_until_idle()
        took.append(time.perf_counter_ns() - start)
    graph.close_all_packet_sources()
    graph.wait_until_done()
    assert len(arrived) == count, f"{len(arrived)} of {count} packets arrived"
    print(statistics.median(took))


if __name__ == "__main__":
    main()
