#!/usr/bin/env python3
"""Runs the micro-benchmarks and writes their table, results.md beside this script.

usage: benchmarks/micro/table.py [--program build/release/benchmarks/lumo_micro] [--samples 40] [--resamples 20000]
       [--xml FILE]
With --xml the table is made from what the program wrote before (-r xml) and nothing is run.
"""

import argparse
import pathlib
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import pages

PACKAGES = {
    "Eigen": "libeigen3-dev",
    "Embree": "libembree-dev",
    "SuiteSparse": "libsuitesparse-dev",
    "OpenBLAS": "libopenblas0-pthread",
    "TetGen": "libtet1.5-dev",
    "TBB": "libtbb-dev",
    "Catch2": "catch2",
}
SCALES = [(1e9, "s"), (1e6, "ms"), (1e3, "µs"), (1.0, "ns")]


def run(program, samples, resamples):
    """What the program writes, as XML. Ends where one of its checks fails: then the times mean nothing."""
    done = subprocess.run(
        [program, "-r", "xml", "--benchmark-samples", str(samples), "--benchmark-resamples", str(resamples)],
        capture_output=True,
        text=True,
    )
    if done.returncode != 0:
        sys.stderr.write(done.stdout[-4000:] + done.stderr)
        raise SystemExit(f"{program}: a check failed")
    return done.stdout


def number(value):
    """Three digits, two of what is below a tenth."""
    return (
        f"{value:.0f}"
        if value >= 99.95
        else f"{value:.1f}" if value >= 9.995 else f"{value:.2f}" if value >= 0.0995 else f"{value:.2g}"
    )


def times(values):
    """Numbers in ns, in the unit that suits the first."""
    scale, unit = next(((s, u) for s, u in SCALES if values[0] >= s), (1.0, "ns"))
    return [number(value / scale) for value in values], unit


def rows(text):
    """Of each test case: its name, and per benchmark kernel, input, way and [mean, lower bound, upper bound] in ns."""
    for case in ElementTree.fromstring(text).iter("TestCase"):
        if case.find("OverallResult").get("success") != "true":
            raise SystemExit(f"{case.get('name')}: a check failed")
        found = []
        for benchmark in case.iter("BenchmarkResults"):
            mean = benchmark.find("mean")
            if mean is None:
                raise SystemExit(f"{benchmark.get('name')}: was not timed")
            parts = [part.strip() for part in benchmark.get("name").split("|")]
            found.append(
                (*(parts + ["", ""])[:3], [float(mean.get(key)) for key in ("value", "lowerBound", "upperBound")])
            )
        if found:
            yield case.get("name"), found


def table(found):
    """Lines of Markdown. Ways of one kernel on one input are multiples of the first."""
    lines = ["| kernel | input | by | mean | 95 % interval | for one | × the first |", "|---|---|---|--:|--:|--:|--:|"]
    first = {}
    for kernel, size, way, values in found:
        base = first.setdefault((kernel, size), values[0])
        alone = sum(1 for row in found if row[:2] == (kernel, size)) == 1
        (mean, low, high), unit = times(values)
        count = re.match(r"(\d+) ", size)
        each = "" if not count or count[1] == "1" else "{0[0]} {1}".format(*times([values[0] / int(count[1])]))
        ratio = "" if alone else number(values[0] / base)
        lines.append(f"| {kernel} | {size} | {way} | {mean} {unit} | {low} … {high} {unit} | {each} | {ratio} |")
    return lines


def cached(program, key):
    """An entry of the cache of the build that the program is from."""
    for folder in pathlib.Path(program).resolve().parents:
        cache = folder / "CMakeCache.txt"
        if cache.exists():
            match = re.search(rf"^{key}(?::\w+)?=(.*)$", cache.read_text(encoding="utf-8"), re.MULTILINE)
            return match[1] if match else ""
    return ""


def machine():
    """Name of the processor and its threads."""
    name, threads = pages.processor()
    return f"{name}, {threads} threads"


def versions():
    """Of the Debian packages that the program is made with."""
    if not shutil.which("dpkg-query"):
        return ""
    found = []
    for name, package in PACKAGES.items():
        done = subprocess.run(["dpkg-query", "-W", "-f", "${Version}", package], capture_output=True, text=True)
        if done.returncode == 0 and done.stdout:
            found.append(f"{name} {re.sub(r'^[0-9]+:|[-+].*$', '', done.stdout)}")
    return ", ".join(found)


def page(cases, program, samples, resamples):
    compiler = cached(program, "CMAKE_CXX_COMPILER") or "c++"
    version = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]
    native = ", for the processor at hand" if cached(program, "LUMO_NATIVE") == "ON" else ""
    lines = f"""# Micro-benchmarks

```sh
cmake --preset release -DLUMO_BUILD_BENCHMARKS=ON && cmake --build --preset release --target lumo_micro
benchmarks/micro/table.py        # writes this page; build/release/benchmarks/lumo_micro "[optics]" times one stage alone
```

{machine()}; {version}, {cached(program, "CMAKE_BUILD_TYPE") or "unknown"} build{native}; {versions()}. {samples} samples each, {resamples} resamples.

**Absolute times are noise here**: the machine is shared, and memory and clock are not this program's own. Compare what stands in one table of one run, and distrust
a mean with a wide interval: Catch2 reports the mean of all samples, those with an interruption included, and a 95 % interval of it by bootstrap.
"For one" is the mean over the input's first number; "× the first" is the mean over that of the first way to do the same on the same input: above 1 is slower.
All on one thread but for the executors. Inputs are small, so that all takes about a minute and a half:
a real press has several times as many elements and an evaluation 32 times as many rays, where ratios can differ.
Before each timing the program checks what it is about to time (powers add up, twins agree); where that fails there is no table.
""".splitlines()
    stage = None
    for name, found in cases:
        folder, _, title = name.partition(": ")
        if folder != stage:
            lines += ["", f"## {folder}"]
            stage = folder
        lines += ["", f"### {title}", "", *table(found)]
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default=HERE.parent.parent / "build/release/benchmarks/lumo_micro")
    parser.add_argument("--samples", type=int, default=40)
    parser.add_argument("--resamples", type=int, default=20000)
    parser.add_argument("--xml")
    arguments = parser.parse_args()
    text = (
        pathlib.Path(arguments.xml).read_text(encoding="utf-8")
        if arguments.xml
        else run(arguments.program, arguments.samples, arguments.resamples)
    )
    benchmarks = list(ElementTree.fromstring(text).iter("BenchmarkResults"))
    if not benchmarks:
        raise SystemExit("nothing was timed")
    samples, resamples = benchmarks[0].get("samples"), benchmarks[0].get("resamples")
    (HERE / "results.md").write_text(page(rows(text), arguments.program, samples, resamples), encoding="utf-8")


main()
