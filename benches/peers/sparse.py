"""Wall time and memory of exact blends of a box in one to four dimensions against sparse solvers of
SciPy and PyAMG and fast transforms of pie-torch.

    pip install numpy scipy pyamg torch pie-torch
    cargo build --release -p npsolve-benches
    python benches/peers/sparse.py [--dimensions 1 2 3 4] [--quick] [--most SAMPLES] [--repeats 3] [--program PATH]

The same samples for all: one channel of waves with a little noise, a cube of n^D samples taken from the
patch, eight samples of background around it. What is timed begins with arrays in memory and ends with
the blended values; setting up the system is a part of it.

npsolve       the screened objective on cubic splines, `dimension_timing`, f32, tolerance 1e-6
  dirichlet   the same with fixed values outside, the problem closest to the peers'
spsolve       scipy.sparse.linalg.spsolve as it comes
splu          scipy.sparse.linalg.splu with the ordering and options for symmetric matrices
cg            scipy.sparse.linalg.cg, no preconditioner, rtol 1e-6
amg           pyamg.ruge_stuben_solver, its V-cycles accelerated by cg to 1e-6
sine          scipy.fft.dstn and back, the fast transform that diagonalises a box and nothing else
pie-dst       pietorch.blend_dst_numpy, the same idea; on one side of every axis the links at the box's edge
              follow the background, not the patch, so its residual is not comparable
pie-green     pietorch.blend on the CPU, a convolution with Green's function by FFT: without fixed values
              around the box, so another problem

SciPy's and PyAMG's solve the plain Dirichlet problem on the box's samples in f64: 2 D + 1 points. `residual`
is |b - A x| / |b| of that system, of npsolve the one it stops at.
Every case runs in a process of its own, with 2 threads, once without being timed (unless that takes more
than 10 s) and once timed; rounds go through all cases. A case above 60 s or 8 GiB is stopped, and neither
repeated nor tried at larger sizes. Memory is the most the process had, in Python less what it had after its
imports, per sample of the box.
"""
import argparse
import importlib.metadata
import json
import os
import pathlib
import statistics
import subprocess
import sys
import time

import machine

THREADS = 2
MARGIN = 8
TOLERANCE = 1e-6
MOST_SECONDS, MOST_BYTES = 60.0, 8 << 30
WARM_BELOW = 10.0
SIZES = {
    1: [10_000, 100_000, 1_000_000, 10_000_000],
    2: [128, 256, 512, 1024, 2048, 4096],
    3: [24, 48, 96, 144, 192],
    4: [10, 16, 24, 32, 40],
}
QUICK = {1: [10_000, 100_000], 2: [64, 128], 3: [12, 24], 4: [9, 12]}
OURS = {"npsolve": [], "dirichlet": ["--dirichlet"]}
PIE = ["pie-dst", "pie-green"]
PEERS = ["spsolve", "splu", "cg", "amg", "sine", *PIE]


def waves(shape, frequency):
    """The same as `waves` of `dimension_timing`, whose first axis is NumPy's last."""
    import numpy as np
    total = np.zeros(shape[::-1], np.float32)
    for axis, n in enumerate(shape):
        line = np.sin(np.float32(frequency) * np.arange(n, dtype=np.float32)
                      + np.float32(10 * frequency))
        total += line.reshape([-1 if d == len(shape) - 1 - axis else 1 for d in range(len(shape))])
    k = np.arange(total.size, dtype=np.uint32)
    noise = ((k * np.uint32(2_654_435_761)) >> 16).astype(np.float32).reshape(total.shape)
    return np.float32(0.5) + np.float32(0.2 / len(shape)) * total + np.float32(0.05 / 65536) * noise


def inner(array):
    return array[(slice(MARGIN, -MARGIN),) * array.ndim]


def laplacian(n, dims):
    """Minus the Laplacian of a box with fixed values around it, as a sum of Kronecker products."""
    import scipy.sparse as sparse
    line = sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    matrix = line
    for d in range(1, dims):
        matrix = sparse.kron(sparse.eye_array(n), matrix) + sparse.kron(line, sparse.eye_array(n**d))
    return matrix.tocsc()


def load(background, patch):
    """The right-hand side: the patch's own Laplacian, and what the background fixes around the box."""
    import numpy as np
    dims = patch.ndim
    b = 2.0 * dims * inner(patch).astype(np.float64)
    around = background.astype(np.float64)
    inner(around)[...] = 0.0
    for axis in range(dims):
        for step in (-1, 1):
            at = tuple(slice(MARGIN + step * (d == axis), s - MARGIN + step * (d == axis))
                       for d, s in enumerate(patch.shape))
            b += around[at] - patch[at]
    return b


def sine_solution(b):
    """The eigenvectors of `laplacian` are products of sines."""
    import numpy as np
    import scipy.fft
    with scipy.fft.set_workers(THREADS):
        spectrum = scipy.fft.dstn(b, type=1)
        for_line = [2.0 - 2.0 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1)) for n in b.shape]
        spectrum /= sum(np.ix_(*for_line))
        return scipy.fft.idstn(spectrum, type=1)


def sparse_solution(peer, matrix, b):
    import scipy.sparse.linalg as linalg
    if peer == "spsolve":
        return linalg.spsolve(matrix, b)
    if peer == "splu":
        options = {"SymmetricMode": True}
        factors = linalg.splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        return factors.solve(b)
    if peer == "cg":
        x, info = linalg.cg(matrix.tocsr(), b, rtol=TOLERANCE, maxiter=1_000_000)
        assert info == 0, f"cg: {info}"
        return x
    import pyamg
    hierarchy = pyamg.ruge_stuben_solver(matrix.tocsr())
    return hierarchy.solve(b, tol=TOLERANCE, accel="cg")


def transformed(peer, background, patch):
    """pie-torch takes the box with one sample around it, and a mask of it."""
    import numpy as np
    import pietorch
    corner = MARGIN - 1
    source = patch[(slice(corner, -corner),) * patch.ndim]
    if peer == "pie-dst":
        import scipy.fft
        with scipy.fft.set_workers(THREADS):
            blend = pietorch.blend_dst_numpy(background, source, np.ones_like(source),
                                             np.full(patch.ndim, corner), False)
    else:
        import torch
        torch.set_num_threads(THREADS)
        blend = pietorch.blend(torch.from_numpy(background), torch.from_numpy(source.copy()),
                               torch.ones(source.shape), torch.full((patch.ndim,), corner), False).numpy()
    return inner(blend)


def child(peer, n, dims):
    """One case in this process; prints a JSON line."""
    import numpy as np
    import scipy.fft
    import scipy.sparse.linalg

    if peer == "amg":
        import pyamg
    if peer in PIE:
        import pietorch

    before = peak_of("self")
    shape = [n + 2 * MARGIN] * dims
    background, patch = waves(shape, 0.11), waves(shape, 0.17)

    def run():
        begin = time.perf_counter()
        if peer in PIE:
            x = transformed(peer, background, patch)
        elif peer == "sine":
            x = sine_solution(load(background, patch))
        else:
            x = sparse_solution(peer, laplacian(n, dims), load(background, patch).ravel())
        return x, time.perf_counter() - begin

    x, seconds = run()
    if seconds < WARM_BELOW:
        x, seconds = run()
    bytes_taken, residual = peak_of("self") - before, None
    if peer not in PIE:
        b = load(background, patch).ravel()
        residual = float(np.linalg.norm(laplacian(n, dims) @ x.ravel() - b) / np.linalg.norm(b))
    print(json.dumps({"seconds": seconds, "peak_bytes": bytes_taken, "residual": residual}))


def peak_of(process):
    """The most memory that a process has had, in bytes; 0 where the system does not tell."""
    try:
        for line in open(f"/proc/{process}/status"):
            if line.startswith("VmHWM:"):
                return 1024 * int(line.split()[1])
    except OSError:
        pass
    return 0


def run_case(case, n, dims, program):
    """What a case's process printed, or why it was stopped."""
    environment = {**os.environ, **{name: str(THREADS) for name in (
        "RAYON_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}}
    if case in OURS:
        command = [program, *OURS[case], "1", "2", *[str(n)] * dims]
    else:
        command = [sys.executable, __file__, "--child", case, str(n), str(dims)]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                               text=True)
    # Twice, and the time that making and checking the problem takes.
    begin, most = time.monotonic(), MOST_SECONDS + WARM_BELOW + 10.0
    while process.poll() is None:
        why = "time" if time.monotonic() - begin > most else "memory"
        if why == "time" or peak_of(process.pid) > MOST_BYTES:
            process.kill()
            process.communicate()
            return {"stopped": why}
        time.sleep(0.02)
    out, error = process.communicate()
    if process.returncode != 0 or not out.strip():
        lines = error.strip().splitlines() or [f"status {process.returncode}"]
        return {"stopped": lines[-1][:60]}
    line = json.loads(out.splitlines()[-1])
    return {"stopped": "time"} if line["seconds"] > MOST_SECONDS else line


def row(dims, n, case, lines, ours):
    """One line of the table."""
    samples = n**dims
    stopped = next((line["stopped"] for line in lines if "stopped" in line), None)
    begin = f"{dims:1d} {f'{n}^{dims}':>11} {samples:>9} {case:<9} "
    if stopped:
        return begin + f"stopped: {stopped}"
    seconds = statistics.median(line["seconds"] for line in lines)
    memory = statistics.median(line["peak_bytes"] for line in lines)
    ratio = f"{seconds / ours:9.2f}" if ours else f"{'':>9}"
    residual = lines[0].get("residual")
    return begin + (f"{seconds:9.4f} {ratio} {1e9 * seconds / samples:10.1f} {memory / samples:10.0f} "
                    f"{'' if residual is None else f'{residual:.0e}':>8}")


def version(package):
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dimensions", type=int, nargs="+", default=[1, 2, 3, 4], choices=[1, 2, 3, 4])
    parser.add_argument("--quick", action="store_true", help="small sizes: does it work?")
    parser.add_argument("--most", type=int, default=1 << 40, help="leave out larger problems")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--only", nargs="+", default=[*OURS, *PEERS], choices=[*OURS, *PEERS])
    parser.add_argument("--program", default=str(machine.ROOT / "target/release/dimension_timing"))
    parser.add_argument("--output", default=None)
    arguments = parser.parse_args()
    found = {name: version(name) for name in ("numpy", "scipy", "pyamg", "torch", "pie-torch")}
    cases = [case for case in arguments.only
             if not (case == "amg" and not found["pyamg"]
                     or case in PIE and not found["pie-torch"])]
    versions = ", ".join(f"{name} {number}" for name, number in found.items() if number)
    out = machine.header("sparse.py", versions) + [
        f"threads   {THREADS} each; medians of {arguments.repeats}; ratio to npsolve's time, above 1 is slower",
        "cases     npsolve and dirichlet: cubic splines; all others: 2 D + 1 points; see sparse.py",
        "",
        f"D {'n^D':>11} {'samples':>9} {'case':<9} {'seconds':>9} {'ratio':>9} {'ns/sample':>10} "
        f"{'bytes/s.':>10} {'residual':>8}",
    ]
    print("\n".join(out), flush=True)
    for dims in arguments.dimensions:
        given_up = {}
        for n in (n for n in (QUICK if arguments.quick else SIZES)[dims] if n**dims <= arguments.most):
            lines = {case: [{"stopped": given_up[case]}] if case in given_up else [] for case in cases}
            for _ in range(arguments.repeats):
                for case in cases:
                    if case not in given_up:
                        line = run_case(case, n, dims, arguments.program)
                        lines[case].append(line)
                        if "stopped" in line:
                            given_up[case] = f"{line['stopped']} at {n}^{dims}"
            times = [line["seconds"] for line in lines.get("npsolve", []) if "seconds" in line]
            ours = statistics.median(times) if times else None
            for case in cases:
                out.append(row(dims, n, case, lines[case], ours))
                print(out[-1], flush=True)
    machine.write(out, arguments.output, "exact-vs-sparse")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
    else:
        main()
