"""Wall time of workload W1 (see `w1_common.py`) in PyTorch on the CPU, in several formulations.

    pip install numpy torch
    python benches/peers/torch_w1.py [--threads 1] [--repeats 7] [--points 65536] [--only NAME ...]
    python benches/peers/torch_w1.py --check

Spatial derivatives by tangents carried through the layers under autograd (`tangents`: a product for
the value and each tangent; `columns`: the same with points along the rows of memory; `stacked`: one
product for all three), by a gradient per output with create_graph (`double backward`), or by
torch.func (`jvp`: both tangents of all points under one vmap; `vmap jvp`: point by point). Sine and
cosine under autograd are calculated again in the backward pass; with `kept sine` a function keeps
them. Each for all points at once and, gradients added up, chunk by chunk; with more than one thread
also with the chunks divided among Python threads of one PyTorch thread each (`divided`). `compiled`
is torch.compile, which needs a C++ compiler; compilation is timed apart.
"""
import concurrent.futures
import os
import sys

import w1_common as common

ARGUMENTS = common.options(__doc__.splitlines()[0])
if not ARGUMENTS.check:  # Compilation is timed, so it must not be found done.
    os.environ["TORCHINDUCTOR_FORCE_DISABLE_CACHES"] = "1"

import torch

OMEGA, TARGET = common.OMEGA, common.TARGET
POOL = concurrent.futures.ThreadPoolExecutor(
    ARGUMENTS.threads, initializer=torch.set_num_threads, initargs=(1,))


class Kept(torch.autograd.Function):
    """Sine and cosine, each the other's derivative."""

    @staticmethod
    def forward(phase):
        return torch.sin(phase), torch.cos(phase)

    @staticmethod
    def setup_context(context, inputs, output):
        context.save_for_backward(*output)

    @staticmethod
    def backward(context, along_sine, along_cosine):
        sine, cosine = context.saved_tensors
        return along_sine * cosine - along_cosine * sine


def library(phase):
    return torch.sin(phase), torch.cos(phase)


def tangents(weights, x, trigonometric=library):
    """Values [n, 3] and both tangents [2, n, 3]; three products [n, 64] [64, 64] per layer."""
    (w, b), *hidden, (last, bias) = weights
    h, slope = trigonometric(torch.addmm(OMEGA * b, x, OMEGA * w))
    along = [slope * (OMEGA * w[0]), slope * (OMEGA * w[1])]
    for w, b in hidden:
        w = OMEGA * w
        value, slope = trigonometric(torch.addmm(OMEGA * b, h, w))
        h, along = value, [slope * (t @ w) for t in along]
    return torch.addmm(bias, h, last), torch.stack([t @ last for t in along])


def columns(weights, x, trigonometric=library):
    """As `tangents`, all transposed; products [64, 64] [64, n]."""
    (w, b), *hidden, (last, bias) = [(w.T, b[:, None]) for w, b in weights]
    h, slope = trigonometric(torch.addmm(OMEGA * b, OMEGA * w, x.T))
    along = [slope * (OMEGA * w[:, :1]), slope * (OMEGA * w[:, 1:])]
    for w, b in hidden:
        w = OMEGA * w
        value, slope = trigonometric(torch.addmm(OMEGA * b, w, h))
        h, along = value, [slope * (w @ t) for t in along]
    return torch.addmm(bias, last, h), torch.stack([last @ t for t in along])


def stacked(weights, x, trigonometric=library):
    """As `tangents`; one product [3 n, 64] [64, 64] per layer."""
    (w, b), *hidden, (last, bias) = weights
    h, slope = trigonometric(torch.addmm(OMEGA * b, x, OMEGA * w))
    block = torch.cat([h[None], slope * (OMEGA * w[:, None])])
    for w, b in hidden:
        y = block @ (OMEGA * w)
        h, slope = trigonometric(y[0] + OMEGA * b)
        block = torch.cat([h[None], slope * y[1:]])
    y = block @ last
    return y[0] + bias, y[1:]


def network(weights, x):
    for w, b in weights[:-1]:
        x = torch.sin(x @ (OMEGA * w) + OMEGA * b)
    w, b = weights[-1]
    return x @ w + b


def double_backward(weights, x):
    x = x.detach().requires_grad_()
    value = network(weights, x)
    return value, torch.stack([
        torch.autograd.grad(value[:, k].sum(), x, create_graph=True)[0] for k in range(3)])


def push(weights, x, tangent):
    return torch.func.jvp(lambda x: network(weights, x), (x,), (tangent,))


def forward_mode(weights, x):
    unit = torch.eye(2)[:, None].expand(2, *x.shape)
    return torch.func.vmap(lambda t: push(weights, x, t), out_dims=(None, 0))(unit)


def forward_mode_by_point(weights, x):
    def point(x):
        return torch.func.vmap(lambda t: push(weights, x, t))(torch.eye(2))
    values, derivative = torch.func.vmap(point, out_dims=1)(x)
    return values[0], derivative


def kept(field):
    return lambda weights, x: field(weights, x, Kept.apply)


def total(field):
    """The loss summed over the points."""
    def loss(weights, x):
        value, derivative = field(weights, x)
        return (value - TARGET).square().sum() + derivative.square().sum()
    return loss


def main():
    weights, x = common.problem(ARGUMENTS.points)
    weights = [tuple(torch.tensor(a, dtype=torch.float32).requires_grad_() for a in layer)
               for layer in weights]
    flat = [array for layer in weights for array in layer]
    x = torch.tensor(x, dtype=torch.float32)

    def accumulate(loss, parts):
        sum_, gradient = 0.0, None
        for part in parts:
            value = loss(weights, part)
            terms = torch.autograd.grad(value, flat)
            sum_ += value.item()
            gradient = list(terms) if gradient is None else torch._foreach_add(gradient, terms)
        return sum_, gradient

    def prepare(loss, chunk, divided, compiled):
        torch.set_num_threads(1 if divided else ARGUMENTS.threads)
        parts = x.split(chunk)
        if compiled:
            torch.compiler.reset()
            loss = torch.compile(loss, dynamic=False)
            accumulate(loss, parts[:1])

        def run():
            torch.set_num_threads(1 if divided else ARGUMENTS.threads)
            if divided:
                share = len(parts) // ARGUMENTS.threads
                shares = [parts[k * share:(k + 1) * share] for k in range(ARGUMENTS.threads)]
                results = list(POOL.map(lambda share: accumulate(loss, share), shares))
            else:
                results = [accumulate(loss, parts)]
            sums, gradients = zip(*results)
            return (sum(sums) / ARGUMENTS.points,
                    [sum(terms).numpy() / ARGUMENTS.points for terms in zip(*gradients)])
        return run

    fields = {"tangents": tangents, "columns": columns, "stacked": stacked,
              "tangents, kept sine": kept(tangents), "columns, kept sine": kept(columns),
              "double backward": double_backward, "jvp": forward_mode,
              "vmap jvp": forward_mode_by_point, "tangents, compiled": tangents,
              "columns, compiled": columns}
    formulations = {}
    for name, field in fields.items():
        cases = {name: (ARGUMENTS.points, False)}
        cases |= {f"{name}, chunks of {c}": (c, False) for c in ARGUMENTS.chunks}
        # Forward mode keeps its state in the process, not the thread.
        if ARGUMENTS.threads > 1 and "jvp" not in name:
            cases |= {f"{name}, divided, chunks of {c}": (c, True) for c in ARGUMENTS.shared_chunks}
        for label, (chunk, divided) in cases.items():
            formulations[label] = (lambda f=total(field), c=chunk, d=divided,
                                   e="compiled" in name: prepare(f, c, d, e))
    return common.measure(ARGUMENTS, "torch", torch.__version__, formulations)


if __name__ == "__main__":
    sys.exit(0 if main() else 1)
