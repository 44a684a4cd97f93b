"""What `jax_w1.py` and `torch_w1.py` share: workload W1, its reference in f64, timing and output.

W1: sine network 2-64-64-64-3, h = sin(30 (x W + b)), linear output, N points in [-1, 1]^2, f32;
loss = mean over the points of sum (value - 0.5)^2 + sum |spatial gradient|^2, for each of the three
outputs and both coordinates. One step is the loss and its gradient with respect to all weights.

Imported before the framework: `options` fixes the processors it may use.
"""
import argparse
import json
import os
import platform
import statistics
import time

import numpy as np

SIZES = [2, 64, 64, 64, 3]
OMEGA, TARGET = 30.0, 0.5
# Multiplications and additions per point: every weight times value and two tangents, forward, for
# the weights' gradient and for the inputs'; less the first layer's products of unit tangents and
# its inputs' gradient, which nobody needs.
PRODUCTS = sum(a * b for a, b in zip(SIZES, SIZES[1:]))
FLOP = 2 * (9 * PRODUCTS - 5 * SIZES[0] * SIZES[1])
# Largest error a check allows, relative to the norm of each weight array's gradient.
TOLERANCE = 1e-4


def options(description):
    """Parses the command line and confines this process to as many processors as `--threads`."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=7, help="steps timed after a discarded one")
    parser.add_argument("--points", type=int, default=65536)
    parser.add_argument("--only", nargs="+", default=[""], help="names contain one of these")
    parser.add_argument("--check", action="store_true", help="compare with f64 for 256 points")
    arguments = parser.parse_args()
    available = sorted(os.sched_getaffinity(0))
    if not 1 <= arguments.threads <= len(available):
        parser.error(f"--threads: 1 to {len(available)} here")
    os.sched_setaffinity(0, available[:arguments.threads])
    os.environ["OMP_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = str(arguments.threads)
    if arguments.check:
        arguments.points, arguments.repeats = 256, 1
    chunks = [64] if arguments.check else [256, 1024, 4096, 16384]
    share = arguments.points // arguments.threads
    if arguments.points % arguments.threads:
        parser.error("--points: a multiple of --threads")
    arguments.chunks = [c for c in chunks if c < arguments.points and arguments.points % c == 0]
    arguments.shared_chunks = [c for c in arguments.chunks if share % c == 0]
    return arguments


def problem(points):
    """Weights [(W, b), ...] by the usual initialisation of sine networks, and points, in f64 but
    exact in f32."""
    random = np.random.default_rng(1)

    def uniform(bound, *shape):
        return random.uniform(-bound, bound, shape).astype(np.float32).astype(np.float64)

    weights = []
    for layer, (a, b) in enumerate(zip(SIZES, SIZES[1:])):
        bound = 1 / a if layer == 0 else np.sqrt(6 / a) / OMEGA
        weights.append((uniform(bound, a, b), uniform(bound, b)))
    return weights, uniform(1.0, points, SIZES[0])


def reference_loss(weights, x):
    """The loss in f64, tangents carried forward."""
    h, tangents = x, [np.eye(2)[[d]] for d in range(2)]
    for w, b in weights[:-1]:
        phase = OMEGA * (h @ w + b)
        h, tangents = np.sin(phase), [OMEGA * np.cos(phase) * (t @ w) for t in tangents]
    w, b = weights[-1]
    error = ((h @ w + b - TARGET) ** 2).sum(1)
    return (error + sum(((t @ w) ** 2).sum(1) for t in tangents)).mean()


def check_reference(weights, x, loss, gradient):
    """Largest error against the f64 loss and its central differences in four entries per array."""
    random, worst = np.random.default_rng(2), abs(loss / reference_loss(weights, x) - 1)
    arrays = [array for layer in weights for array in layer]
    for array, ours in zip(arrays, gradient):
        for index in random.integers(0, array.size, 4):
            kept, step, sides = array.flat[index], 1e-6, []
            for sign in (1, -1):
                array.flat[index] = kept + sign * step
                sides.append(reference_loss(weights, x))
            array.flat[index] = kept
            exact = (sides[0] - sides[1]) / (2 * step)
            worst = max(worst, abs(ours.flat[index] - exact) / np.linalg.norm(ours))
    return worst


def cpu_model():
    try:
        for line in open("/proc/cpuinfo"):
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def measure(arguments, framework, version, formulations):
    """Prints the header, then a JSON line for each formulation: name -> prepare, where prepare()
    compiles and returns a step, and step() returns the loss and a flat list of gradient arrays.
    `difference` is the gradient's from the first formulation's, `processors` the processor time per
    wall time. Returns whether all agree."""
    print(json.dumps({"cpu": cpu_model(), "python": platform.python_version(), framework: version,
                      "numpy": np.__version__, "threads": arguments.threads}), flush=True)
    first, good, best = None, True, None
    for name, prepare in formulations.items():
        if not any(part in name for part in arguments.only):
            continue
        line = {"framework": framework, "version": version, "threads": arguments.threads,
                "points": arguments.points, "formulation": name}
        try:
            start = time.perf_counter()
            step = prepare()
            line["compile_seconds"] = round(time.perf_counter() - start, 3)
            loss, gradient = step()
        except Exception as error:  # A formulation this installation cannot run; the others can.
            line["failed"] = f"{type(error).__name__}: {error}"[:200]
            print(json.dumps(line), flush=True)
            good = False
            continue
        loss, gradient = float(loss), [np.array(g, np.float64) for g in gradient]
        if first is None:
            first = loss, gradient
            if arguments.check:
                error = check_reference(*problem(arguments.points), loss, gradient)
                print(json.dumps({"formulation": name, "against_f64": float(f"{error:.2e}")}))
                good &= error < TOLERANCE
        difference = max([abs(loss / first[0] - 1)] + [
            np.linalg.norm(a - b) / np.linalg.norm(b) for a, b in zip(gradient, first[1])])
        good &= difference < TOLERANCE
        seconds, used, began = [], time.process_time(), time.perf_counter()
        for _ in range(arguments.repeats):
            start = time.perf_counter()
            step()
            seconds.append(time.perf_counter() - start)
        used = (time.process_time() - used) / (time.perf_counter() - began)
        median = statistics.median(seconds)
        line |= {"median_seconds": round(median, 5), "best_seconds": round(min(seconds), 5),
                 "gflops": round(FLOP * arguments.points / median / 1e9, 2),
                 "processors": round(used, 2), "difference": float(f"{difference:.1e}")}
        print(json.dumps(line), flush=True)
        if best is None or median < best["median_seconds"]:
            best = line
    if best and not arguments.check:
        print(json.dumps({"best": best["formulation"], "median_seconds": best["median_seconds"],
                          "gflops": best["gflops"]}))
    if arguments.check:
        print("agree" if good else "DISAGREE")
    return good
