"""The exact blend of whole scenes against an independent implementation of its discretisation.

    pip install numpy scipy opencv-python-headless
    cargo build --release -p npsolve-cli
    python benches/peers/reference.py [--data FOLDER] [--scenes NAME ...] [--length 2] [--program PATH]

The reference is assembled in f64 from its definition: cubic B-splines with knots at the samples,
mirrored at the border; integrals by two points per knot interval and axis, at 1/4 and 3/4; the mask
constant on sample cells; `v` the patch's gradient inside and the background's outside. The sparse
system of a box around the region (the change has decayed beyond) is solved by conjugate gradients
with an incomplete factorisation to 1e-12. Reports the root mean square difference inside the region
in grey levels.
"""
import argparse
import datetime
import json
import os
import pathlib
import platform
import subprocess
import sys
import tempfile

os.environ.setdefault("OPENCV_IO_ENABLE_OPENEXR", "1")

import cv2
import numpy as np
import scipy
import scipy.sparse as sp
import scipy.sparse.linalg as spla

ROOT = pathlib.Path(__file__).resolve().parents[2]
# The change falls as exp(-d / length): 1e-10 at this many lengths, plus the basis' own reach.
REACH_IN_LENGTHS, REACH = 23, 12


def basis(n):
    """Values and slopes of the n splines at the 2 (n - 1) points, values at the knots."""
    def b(x):
        a = np.abs(x)
        return np.where(a < 1, 2 / 3 - a**2 + a**3 / 2, np.where(a < 2, (2 - a) ** 3 / 6, 0))

    def slope(x):
        a = np.abs(x)
        return np.sign(x) * np.where(a < 1, 1.5 * a**2 - 2 * a,
                                     np.where(a < 2, -((2 - a) ** 2) / 2, 0))

    def matrix(points, f):
        knots = np.floor(points).astype(int)[:, None] + np.arange(-1, 3)
        values = f(points[:, None] - knots)
        period = 2 * (n - 1)
        folded = np.mod(knots, period)
        folded = np.where(folded < n, folded, period - folded)
        rows = np.repeat(np.arange(len(points)), 4)
        return sp.csr_matrix((values.ravel(), (rows, folded.ravel())), (len(points), n))

    points = (np.arange(n - 1)[:, None] + [0.25, 0.75]).ravel()
    return matrix(points, b), matrix(points, slope), matrix(np.arange(n, dtype=float), b), points


def coefficients(picture, knots):
    """Spline coefficients of a picture (H, W)."""
    columns = spla.spsolve(knots[0].tocsc(), picture)
    return spla.spsolve(knots[1].tocsc(), columns.T).T


def blend(background, patch, mask, length):
    """The blend of arrays (H, W, C) of one shape; `mask` (H, W) in [0, 1]."""
    h, w = mask.shape
    (by, dy, py, ty), (bx, dx, px, tx) = basis(h), basis(w)
    value, ddx, ddy = sp.kron(by, bx).tocsr(), sp.kron(by, dx).tocsr(), sp.kron(dy, bx).tocsr()
    # The cell of a point is that of its nearest sample.
    inside = mask[np.rint(ty).astype(int)][:, np.rint(tx).astype(int)].ravel()
    weight = sp.diags((1 - inside) / length**2)
    matrix = (ddx.T @ ddx + ddy.T @ ddy + value.T @ weight @ value).tocsc()
    factor = spla.spilu(matrix, drop_tol=1e-4, fill_factor=12)
    preconditioner = spla.LinearOperator(matrix.shape, factor.solve)
    result = np.empty_like(background)
    for c in range(background.shape[2]):
        s = coefficients(background[..., c], (py, px)).ravel()
        t = coefficients(patch[..., c], (py, px)).ravel()
        # For the change e = c - s: grad e follows m (grad t - grad s), e is 0 outside.
        right = ddx.T @ (inside * (ddx @ (t - s))) + ddy.T @ (inside * (ddy @ (t - s)))
        change, info = spla.cg(matrix, right, rtol=1e-12, atol=0, maxiter=5000, M=preconditioner)
        if info:
            sys.exit(f"the reference did not converge: {info}")
        result[..., c] = background[..., c] + py @ change.reshape(h, w) @ px.T
    return result


def read(path):
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if picture is None:
        sys.exit(f"cannot read {path}")
    picture = picture[..., None] if picture.ndim == 2 else picture[..., 2::-1]
    scale = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}.get(picture.dtype, 1)
    return picture.astype(np.float64) / scale


def check(scene, name, data, program, length):
    background, patch = read(data / scene["background"]), read(data / scene["patch"])
    mask = read(data / scene["masks"][name])[..., 0]
    x, y = scene["offset"]
    inside = np.zeros(background.shape[:2])
    placed = np.zeros_like(background)
    ph, pw = patch.shape[:2]
    inside[y:y + ph, x:x + pw] = mask
    # Mirrored beyond its border, as its spline is.
    placed[:] = cv2_pad(patch, y, background.shape[0] - y - ph, x, background.shape[1] - x - pw)
    rows, columns = np.nonzero(inside.any(1))[0], np.nonzero(inside.any(0))[0]
    reach = int(np.ceil(REACH_IN_LENGTHS * length)) + REACH
    box = (slice(max(rows[0] - reach, 0), rows[-1] + reach + 1),
           slice(max(columns[0] - reach, 0), columns[-1] + reach + 1))
    want = blend(background[box], placed[box], inside[box], length)
    with tempfile.TemporaryDirectory() as folder:
        output = pathlib.Path(folder) / "x.npy"
        command = [program, "blend", data / scene["background"], data / scene["patch"],
                   "--mask", data / scene["masks"][name], "--at", f"{x},{y}",
                   "--length", str(length), "-o", output, "--depth", "f32", "--quiet"]
        subprocess.run([str(v) for v in command], check=True)
        got = np.load(output).astype(np.float64)
    got = got.reshape(background.shape)[box]
    difference, m = 255 * (got - want), inside[box][..., None]
    rmse = np.sqrt((m * difference**2).sum() / (m.sum() * background.shape[2]))
    return rmse, np.abs(m * difference).max()


def cv2_pad(patch, top, bottom, left, right):
    return np.pad(patch, ((top, bottom), (left, right), (0, 0)), mode="reflect")


def cpu_model():
    try:
        for line in open("/proc/cpuinfo"):
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--data", type=pathlib.Path, default=ROOT.parent / "shared/data")
    parser.add_argument("--scenes", nargs="+", help="names of scenes; all by default")
    parser.add_argument("--length", type=float, default=2.0)
    parser.add_argument("--program", default=str(ROOT / "target/release/npsolve"))
    parser.add_argument("--output", type=pathlib.Path,
                        default=ROOT / "benches/results/reference-scenes.txt")
    arguments = parser.parse_args()
    manifest = json.loads((arguments.data / "manifest.json").read_text())
    out = [
        f"date      {datetime.date.today()}",
        f"machine   {cpu_model()}, {os.cpu_count()} logical cores, {platform.system()}",
        f"versions  NumPy {np.__version__}, SciPy {scipy.__version__}",
        f"command   python benches/peers/reference.py --length {arguments.length:g}",
        "difference of the exact blend to the reference, inside the region, in grey levels (1/255)",
        "",
        f"{'scene/mask':32} {'RMSE':>10} {'largest':>10}",
    ]
    print("\n".join(out), flush=True)
    for scene in manifest["blend_2d"]:
        if arguments.scenes and scene["name"] not in arguments.scenes:
            continue
        for name in scene["masks"]:
            rmse, largest = check(scene, name, arguments.data, arguments.program, arguments.length)
            row = f"{scene['name'] + '/' + name:32} {rmse:10.2e} {largest:10.2e}"
            print(row, flush=True)
            out.append(row)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text("\n".join(out) + "\n")
    print(f"written to {arguments.output}")


if __name__ == "__main__":
    main()
