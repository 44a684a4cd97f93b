"""Wall time of workload W1 (see `w1_common.py`) in JAX on the CPU, in several formulations.

    pip install numpy "jax[cpu]"
    python benches/peers/jax_w1.py [--threads 1] [--repeats 7] [--points 65536] [--only NAME ...]
    python benches/peers/jax_w1.py --check

Spatial derivatives by tangents carried through the layers (`tangents`: a product for the value and
each tangent; `columns`: the same with points along the rows of memory; `stacked`: one product for
all three), by forward mode (`jvp`) or reverse mode (`jacrev`) at each point under vmap. Each for
all points at once and, by lax.scan, chunk by chunk, forward and backward pass within the chunk;
with more than one thread also with the points divided among as many CPU devices (`sharded`). XLA
calculates `jnp.sin` on the CPU an element at a time, so each also with a sine that it can
vectorise (`polynomial sine`). Compilation is timed apart.
"""
import os
import sys

import w1_common as common

ARGUMENTS = common.options(__doc__.splitlines()[0])
os.environ["JAX_PLATFORMS"] = "cpu"
# XLA sizes its pools by the processors this process is confined to.
FLAGS = [f"--xla_force_host_platform_device_count={ARGUMENTS.threads}"]
if ARGUMENTS.threads == 1:
    FLAGS.append("--xla_cpu_multi_thread_eigen=false")
os.environ["XLA_FLAGS"] = " ".join([os.environ.get("XLA_FLAGS", ""), *FLAGS])

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

OMEGA, TARGET = common.OMEGA, common.TARGET


# pi / 2 in three parts, the first two of few bits.
HALF_PI = 1.5703125, 4.837512969970703125e-4, 7.549789948768648e-8


@jax.custom_jvp
def polynomial(phase):
    """Sine and cosine to about the last bit of f32 for phases up to some thousands."""
    k = jnp.round(phase * (2 / np.pi))
    r = ((phase - k * HALF_PI[0]) - k * HALF_PI[1]) - k * HALF_PI[2]
    z, k = r * r, k.astype(jnp.int32)
    s = r + r * z * (-1.6666654611e-1 + z * (8.3321608736e-3 + z * -1.9515295891e-4))
    c = 1 - 0.5 * z + z * z * (4.166664568298827e-2 + z * (
        -1.388731625493765e-3 + z * 2.443315711809948e-5))
    sine, cosine = jnp.where(k & 1, c, s), jnp.where(k & 1, s, c)
    return jnp.where(k & 2, -sine, sine), jnp.where((k + 1) & 2, -cosine, cosine)


@polynomial.defjvp
def _(phase, tangent):
    sine, cosine = polynomial(*phase)
    return (sine, cosine), (cosine * tangent[0], -sine * tangent[0])


def library(phase):
    return jnp.sin(phase), jnp.cos(phase)


def tangents(weights, x, trigonometric):
    """Values [n, 3] and both tangents [2, n, 3]; three products [n, 64] [64, 64] per layer."""
    (w, b), *hidden, (last, bias) = weights
    h, slope = trigonometric(OMEGA * (x @ w + b))
    along = [OMEGA * slope * w[0], OMEGA * slope * w[1]]
    for w, b in hidden:
        value, slope = trigonometric(OMEGA * (h @ w + b))
        h, along = value, [OMEGA * slope * (t @ w) for t in along]
    return h @ last + bias, jnp.stack([t @ last for t in along])


def columns(weights, x, trigonometric):
    """As `tangents`, all transposed; products [64, 64] [64, n]."""
    (w, b), *hidden, (last, bias) = [(w.T, b[:, None]) for w, b in weights]
    h, slope = trigonometric(OMEGA * (w @ x.T + b))
    along = [OMEGA * slope * w[:, :1], OMEGA * slope * w[:, 1:]]
    for w, b in hidden:
        value, slope = trigonometric(OMEGA * (w @ h + b))
        h, along = value, [OMEGA * slope * (w @ t) for t in along]
    return last @ h + bias, jnp.stack([last @ t for t in along])


def stacked(weights, x, trigonometric):
    """As `tangents`; one product [3 n, 64] [64, 64] per layer."""
    (w, b), *hidden, (last, bias) = weights
    h, slope = trigonometric(OMEGA * (x @ w + b))
    block = jnp.concatenate([h[None], OMEGA * slope * w[:, None]])
    for w, b in hidden:
        y = block @ w
        h, slope = trigonometric(OMEGA * (y[0] + b))
        block = jnp.concatenate([h[None], OMEGA * slope * y[1:]])
    y = block @ last
    return y[0] + bias, y[1:]


def network(weights, x, trigonometric):
    for w, b in weights[:-1]:
        x = trigonometric(OMEGA * (x @ w + b))[0]
    w, b = weights[-1]
    return x @ w + b


def forward_mode(weights, x, trigonometric):
    def point(x):
        push = lambda t: jax.jvp(lambda x: network(weights, x, trigonometric), (x,), (t,))
        return jax.vmap(push, out_axes=(None, 0))(jnp.eye(2))
    return jax.vmap(point)(x)


def reverse_mode(weights, x, trigonometric):
    def point(x):
        value, pull = jax.vjp(lambda x: network(weights, x, trigonometric), x)
        return value, jax.vmap(pull)(jnp.eye(3))[0]
    return jax.vmap(point)(x)


def total(field, trigonometric):
    """The loss summed over the points, and its gradient."""
    def loss(weights, x):
        value, derivative = field(weights, x, trigonometric)
        return jnp.sum((value - TARGET) ** 2) + jnp.sum(derivative**2)
    return jax.value_and_grad(loss)


def chunked(step, chunk):
    def steps(weights, x):
        def add(sum_, part):
            return jax.tree.map(jnp.add, sum_, step(weights, part)), None
        zero = jnp.zeros(()), jax.tree.map(jnp.zeros_like, weights)
        return jax.lax.scan(add, zero, x.reshape(-1, chunk, x.shape[1]))[0]
    return steps


def sharded(step, mesh):
    def shard(weights, x):
        return jax.lax.psum(step(weights, x), "points")
    return jax.shard_map(shard, mesh=mesh, in_specs=(PartitionSpec(), PartitionSpec("points")),
                         out_specs=PartitionSpec(), check_vma=False)


def main():
    weights, x = common.problem(ARGUMENTS.points)
    weights = [(jnp.array(w, jnp.float32), jnp.array(b, jnp.float32)) for w, b in weights]
    x = jnp.array(x, jnp.float32)
    mesh = jax.make_mesh((ARGUMENTS.threads,), ("points",))

    def prepare(step, divided):
        def mean(weights, x):
            loss, gradient = step(weights, x)
            return loss / len(x), jax.tree.map(lambda g: g / ARGUMENTS.points, gradient)

        data = (weights, x)
        if divided:
            data = (jax.device_put(weights, NamedSharding(mesh, PartitionSpec())),
                    jax.device_put(x, NamedSharding(mesh, PartitionSpec("points"))))
        compiled = jax.jit(mean).lower(*data).compile()

        def run():
            loss, gradient = jax.block_until_ready(compiled(*data))
            return loss, [np.asarray(g) for g in jax.tree.leaves(gradient)]
        return run

    formulations, fields = {}, {"tangents": tangents, "columns": columns, "stacked": stacked,
                                "vmap jvp": forward_mode, "vmap jacrev": reverse_mode}
    for sine, trigonometric in [("", library), (", polynomial sine", polynomial)]:
        for name, field in fields.items():
            name, step = name + sine, total(field, trigonometric)
            steps = {name: step}
            steps |= {f"{name}, chunks of {c}": chunked(step, c) for c in ARGUMENTS.chunks}
            if ARGUMENTS.threads > 1:
                steps[f"{name}, sharded"] = sharded(step, mesh)
                steps |= {f"{name}, sharded, chunks of {c}": sharded(chunked(step, c), mesh)
                          for c in ARGUMENTS.shared_chunks}
            for label, step in steps.items():
                formulations[label] = lambda step=step, d="sharded" in label: prepare(step, d)
    return common.measure(ARGUMENTS, "jax", jax.__version__, formulations)


if __name__ == "__main__":
    sys.exit(0 if main() else 1)
