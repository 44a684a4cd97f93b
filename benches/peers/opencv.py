"""Wall time of an exact blend against OpenCV's seamlessClone, interleaved in one run.

    pip install numpy opencv-python-headless
    cargo build --release -p npsolve-benches
    python benches/peers/opencv.py [--sizes 256 512 ...] [--repeats 5] [--program PATH]

Per size and repetition OpenCV runs once (NORMAL_CLONE, 2 threads, 8-bit RGB picture of n + 256
square, patch of n square, the whole rectangle less its border as mask), then `exact_timing` once
per tolerance and length, warm like OpenCV. The first repetition is discarded.
"""
import argparse
import json
import statistics
import subprocess
import time

import cv2
import numpy as np

import machine

THREADS = 2
CASES = [("1e-4", "4"), ("1e-4", "0"), ("1e-6", "4"), ("1e-6", "0")]


def waves(n, phase):
    """The same waves as `npsolve_benches::waves`, in 8 bits."""
    y, x = np.mgrid[0:n, 0:n].astype(np.float32)
    scale, planes = 6.0 / n, []
    for channel in range(3):
        c = channel + phase
        slow = np.sin(scale * x + c) + np.cos(scale * y * 1.3 - c)
        fast = np.sin(0.37 * x + 0.21 * y + c) * np.cos(0.11 * x - 0.29 * y)
        planes.append(0.5 + 0.15 * slow + 0.1 * fast)
    return np.clip(np.rint(255 * np.stack(planes, -1)), 0, 255).astype(np.uint8)


def opencv_seconds(background, patch, mask):
    centre = (background.shape[1] // 2, background.shape[0] // 2)
    start = time.perf_counter()
    cv2.seamlessClone(patch, background, mask, centre, cv2.NORMAL_CLONE)
    return time.perf_counter() - start


def exact_seconds(program, n, tolerance, length):
    # OpenCV runs in this process, whose threads and memory are warm. So that ours are as well, the
    # first blends of a fresh process are discarded: one, or two of those that take milliseconds.
    cold = 2 if n <= 1024 else 1
    command = [program, str(n), length, tolerance, str(THREADS), str(cold + 1)]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    return json.loads(lines[-1])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--sizes", type=int, nargs="+", default=[256, 512, 1024, 2048, 4096])
    parser.add_argument("--repeats", type=int, default=5, help="repetitions after the first")
    parser.add_argument("--program", default=str(machine.ROOT / "target/release/exact_timing"))
    parser.add_argument("--output", default=None)
    arguments = parser.parse_args()
    cv2.setNumThreads(THREADS)
    out = machine.header("opencv.py", f"OpenCV {cv2.__version__}, NumPy {np.__version__}") + [
        f"threads   {THREADS} each; {arguments.repeats} repetitions after a discarded one; seconds",
        "",
        f"{'n':>5} {'tolerance':>9} {'length':>7} {'iterations':>10} {'exact median':>12} {'min':>8} "
        f"{'OpenCV median':>13} {'min':>8} {'ratio of medians':>16} {'of minima':>9}",
    ]
    print("\n".join(out), flush=True)
    for n in arguments.sizes:
        background, patch = waves(n + 256, 1.7), waves(n, 0.0)
        mask = np.zeros((n, n), np.uint8)
        mask[1:-1, 1:-1] = 255
        peer, ours = [], {case: [] for case in CASES}
        for repeat in range(arguments.repeats + 1):
            seconds = opencv_seconds(background, patch, mask)
            lines = {case: exact_seconds(arguments.program, n, *case) for case in CASES}
            if repeat > 0:
                peer.append(seconds)
                for case, line in lines.items():
                    ours[case].append(line)
        for case in CASES:
            seconds = [line["seconds"] for line in ours[case]]
            median, least = statistics.median(seconds), min(seconds)
            peer_median, peer_least = statistics.median(peer), min(peer)
            row = (f"{n:5d} {case[0]:>9} {ours[case][0]['length']:7.2f} "
                   f"{ours[case][0]['iterations']:10d} {median:12.4f} {least:8.4f} "
                   f"{peer_median:13.4f} {peer_least:8.4f} {median / peer_median:16.3f} "
                   f"{least / peer_least:9.3f}")
            print(row, flush=True)
            out.append(row)
    machine.write(out, arguments.output, "exact-vs-opencv")


if __name__ == "__main__":
    main()
