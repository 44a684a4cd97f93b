"""What the scripts that run a program beside a peer say about where they ran."""
import datetime
import os
import pathlib
import platform
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]


def cpu_model():
    try:
        for line in open("/proc/cpuinfo"):
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def header(script, versions):
    """The first lines of a result: date, machine, versions and command. `versions` are the peers'."""
    commit = subprocess.run(["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"],
                            capture_output=True, text=True).stdout.strip()
    return [
        f"date      {datetime.date.today()}",
        f"machine   {cpu_model()}, {os.cpu_count()} logical cores, {platform.system()}",
        f"versions  npsolve {commit}, {versions}, Python {platform.python_version()}",
        f"command   python benches/peers/{script} {' '.join(sys.argv[1:])}",
    ]


def write(lines, output, name):
    """Writes a result to `output`, or under today's date and `name` where results are kept."""
    default = ROOT / f"benches/results/{datetime.date.today()}-{name}.txt"
    path = pathlib.Path(output or default)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    print(f"written to {path}")
