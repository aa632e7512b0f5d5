#!/usr/bin/env python3
"""What the real world does to a search, in ten situations, asked of one or more programs lumo.

usage: benchmarks/optimize/siblings.py [NAME=]PROGRAM...

Prints a table with a column for each program: right or WRONG, and what was seen. Standard library only; some minutes.
"""

import json
import math
import os
import pathlib
import random
import resource
import statistics
import subprocess
import sys
import tempfile


def branin(a, b):
    return (
        (b - 5.1 / (4 * math.pi**2) * a * a + 5 / math.pi * a - 6) ** 2
        + 10 * (1 - 1 / (8 * math.pi)) * math.cos(a)
        + 10
    )


BRANIN = {
    "variables": [{"name": "a", "lower": -5, "upper": 10}, {"name": "b", "lower": 0, "upper": 15}],
    "objectives": [{"name": "f", "goal": "minimize", "reference": 310}],
    "sobol": 8,
    "evaluations": 30,
    "seed": 1,
}
UNIT = {
    "variables": [{"name": f"x{i}", "lower": 0, "upper": 1} for i in range(2)],
    "objectives": [{"name": "f", "goal": "minimize", "reference": 2}],
    "sobol": 5,
    "evaluations": 12,
    "seed": 1,
}


MOST_CPU_S = 20  # of a run; then it is ended


class Search:
    """One run of the program in a folder; `answer(id, x)` gives the line that answers it."""

    def __init__(self, lumo, folder, space, answer, *options, asks=10**9):
        path = pathlib.Path(folder) / "space.json"
        path.write_text(json.dumps(space))
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        process = subprocess.Popen(
            [lumo, "optimize", "--space", str(path), *map(str, options)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_S, MOST_CPU_S)),
        )
        self.x, self.last = [], {}
        for line in process.stdout:
            message = json.loads(line)
            if "ask" not in message:
                self.last = message
                break
            if len(self.x) >= asks:
                break
            self.x.append(message["ask"]["x"])
            try:
                process.stdin.write(json.dumps(answer(message["ask"]["id"], message["ask"]["x"])) + "\n")
                process.stdin.flush()
            except BrokenPipeError:
                break
        try:
            self.said = process.communicate(timeout=600)[1].strip()
        except BrokenPipeError:
            self.said = process.stderr.read().strip()
        self.code = process.wait()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        self.cpu = after.ru_utime - before.ru_utime


def answering(f):
    return lambda id, x: {"tell": {"id": id, "y": [f(*x)]}}


def refused(s):
    return f"exit {s.code}: {s.said[-90:]}"


def one_corner_gives_minus_a_billion(lumo, folder):
    """A region of failed solves gives −10⁹ in a search for the largest value"""
    space = dict(BRANIN, objectives=[{"name": "f", "goal": "maximize", "reference": -310}])
    best = []
    solve = answering(lambda a, b: -1e9 if a > 6 and b > 9 else -branin(a, b))
    for seed in range(1, 6):
        s = Search(lumo, folder, dict(space, seed=seed), solve)
        best.append(-max((one["y"][0] for one in s.last.get("front", [])), default=-math.inf))
    shown = ", ".join(f"{v:.2f}" for v in best)
    return statistics.median(best) < 0.5, f"best of 30, five seeds: {shown} (least: 0.40)"


def one_value_is_absurdly_good(lumo, folder):
    """One value of −10¹² where the least is 0.4 (a unit forgotten)"""
    best, named = [], 0
    for seed in range(1, 6):
        values = []

        def answer(id, x):
            values.append(-1e12 if id == 6 else branin(*x))
            return {"tell": {"id": id, "y": [values[-1]]}}

        s = Search(lumo, folder, dict(BRANIN, seed=seed), answer)
        named += "outlier" in s.said
        best.append(min(v for v in values if v > -1e6))
    shown = ", ".join(f"{v:.2f}" for v in best)
    right = statistics.median(best) < 0.5 and named == 5
    return right, f"best of the others, five seeds: {shown}; named in {named} of 5"


def a_mixture_of_eight(lumo, folder):
    """A mixture: eight shares that sum to 1"""
    space = {
        "variables": [{"name": f"x{i}", "lower": 0, "upper": 1} for i in range(8)],
        "constraints": [{"terms": {f"x{i}": 1 for i in range(8)}, "lower": 0.999, "upper": 1}],
        "objectives": [{"name": "f", "goal": "minimize", "reference": 2}],
        "sobol": 96,
        "evaluations": 96,
        "seed": 3,
    }
    s = Search(lumo, folder, space, answering(lambda *x: 0.5))
    means = [sum(x[i] for x in s.x) / max(1, len(s.x)) for i in range(8)]
    off = max(abs(m - 0.125) for m in means)  # a share's deviation is 0.11, of 96 0.011
    seen = f"{len(s.x)} of 96 starts; a mean share is {off:.3f} off 0.125 (3 errors: 0.034)"
    return len(s.x) == 96 and off < 0.04, seen


def forty_variables(lumo, folder):
    """Starting designs in 40 variables: every coordinate and every pair"""
    space = dict(
        UNIT, variables=[{"name": f"x{i}", "lower": 0, "upper": 1} for i in range(40)], sobol=128, evaluations=128
    )
    s = Search(lumo, folder, space, answering(lambda *x: 0.5))
    columns = list(zip(*s.x))
    centred = [[v - sum(c) / len(c) for v in c] for c in columns]
    dot = lambda a, b: sum(u * v for u, v in zip(a, b))
    worst = max(
        abs(dot(centred[i], centred[j])) / math.sqrt(dot(centred[i], centred[i]) * dot(centred[j], centred[j]))
        for i in range(40)
        for j in range(i)
    )
    return worst < 0.42, f"largest correlation of two variables among 780: {worst:.2f} (uniform: 0.3)"


def fewer_then_another_source(lumo, folder):
    """After twelve evaluations the budget is lowered, then raised with another seed and source; then resumed"""
    file = pathlib.Path(folder) / "run.jsonl"
    f = answering(lambda a, b: (a - 0.3) ** 2 + (b - 0.7) ** 2)
    Search(lumo, folder, UNIT, f, "--transcript", file)
    less = Search(lumo, folder, dict(UNIT, evaluations=8), f, "--transcript", file)
    other = dict(UNIT, evaluations=20, seed=9, source="paper")
    begun = Search(lumo, folder, other, f, "--transcript", file, asks=3)
    rest = Search(lumo, folder, other, f, "--transcript", file)
    right = (less.code, len(less.x), rest.code, len(begun.x) + len(rest.x)) == (0, 0, 0, 8)
    return right, f"exits {less.code} and {rest.code}, {len(begun.x)} + {len(rest.x)} more" + (
        "" if right else f"; {less.said[-70:]}"
    )


def nothing_but_machine_failures(lumo, folder):
    """The licence server is down: every evaluation fails with retry"""
    s = Search(
        lumo, folder, UNIT, lambda id, x: {"fail": {"id": id, "retry": True, "why": "no licence"}}, asks=200
    )
    return s.code == 4 and len(s.x) < 20, f"{len(s.x)} asks, exit {s.code}"


def six_objectives(lumo, folder):
    """Six objectives, 30 designs"""
    space = dict(
        UNIT,
        variables=[{"name": f"x{i}", "lower": 0, "upper": 1} for i in range(6)],
        objectives=[{"name": f"f{i}", "goal": "minimize", "reference": 2} for i in range(6)],
        sobol=30,
        evaluations=31,
    )
    y = lambda x: [sum((v - 0.15 * j) ** 2 for v in x[: j + 1]) / (j + 1) + x[(j + 2) % 6] for j in range(6)]
    s = Search(lumo, folder, space, lambda id, x: {"tell": {"id": id, "y": y(x)}})
    return s.code == 0 and s.cpu < 5, f"{s.cpu:.1f} s of CPU for one ask{' at least' if s.code else ''} (wanted: < 5)"


def lucky_values(lumo, folder):
    """A sphere in three variables, known to 0.3 only, with the error reported by every answer"""
    space = dict(UNIT, variables=[{"name": f"x{i}", "lower": 0, "upper": 1} for i in range(3)], evaluations=30)
    truth = lambda x: sum((v - 0.4) ** 2 for v in x)
    holds, shown = 0, []
    for seed in range(1, 6):
        rng = random.Random(seed)
        answer = lambda id, x: {"tell": {"id": id, "y": [truth(x) + rng.gauss(0, 0.3)], "y_err": [0.3]}}
        s = Search(lumo, folder, dict(space, seed=seed), answer)
        if not s.last.get("front"):
            return False, refused(s)
        best = s.last["front"][0]
        low, high = s.last.get("interval_90", [s.last["hypervolume"]] * 2)
        holds += low <= 2 - truth(best["x"]) <= high
        shown.append(best["y"][0])
    return holds >= 4, f"{holds} of 5 intervals hold the truth; least values claimed {min(shown):.2f} (possible: 0)"


def a_spreadsheet_of_earlier_results(lumo, folder):
    """200 earlier results from a German spreadsheet: decimal commas, outside the bounds, off the step, twice"""
    rng = random.Random(4)
    table = pathlib.Path(folder) / "known.csv"
    points = [(round(rng.uniform(-6, 11), 3), round(rng.uniform(-1, 16), 3)) for _ in range(100)]
    rows = [f"{a};{b};{branin(a, b):.6f}".replace(".", ",") for a, b in points * 2]
    table.write_text("a;b;f\r\n" + "\r\n".join(rows) + "\r\n")
    space = json.loads(json.dumps(BRANIN))
    for v in space["variables"]:
        v["step"] = 0.25
    s = Search(lumo, folder, dict(space, sobol=0, evaluations=6), answering(branin), "--known", table)
    best = min((branin(*x) for x in s.x), default=math.inf)
    return s.code == 0 and best < 0.6, (
        f"best of six: {best:.2f} (least on the lattice: 0.41)" if s.code == 0 else refused(s)
    )


def a_backup_put_back(lumo, folder):
    """The transcript is replaced by yesterday's copy while it is written"""
    file = pathlib.Path(folder) / "run.jsonl"

    def answer(id, x):
        if id == 5:
            os.replace(file, file.with_name("gone"))
            file.write_text("yesterday")
        return {"tell": {"id": id, "y": [x[0]]}}

    s = Search(lumo, folder, UNIT, answer, "--transcript", file)
    kept = [p for p in pathlib.Path(folder).glob("run.jsonl*") if '"tell":{"id":5' in p.read_text()]
    return s.code != 0 and bool(kept), f"exit {s.code}, {len(s.x)} asked, the answer is kept: {bool(kept)}"


SITUATIONS = (
    one_corner_gives_minus_a_billion,
    one_value_is_absurdly_good,
    a_mixture_of_eight,
    forty_variables,
    fewer_then_another_source,
    nothing_but_machine_failures,
    six_objectives,
    lucky_values,
    a_spreadsheet_of_earlier_results,
    a_backup_put_back,
)


def main(programs):
    named = [p.split("=", 1) if "=" in p else (p, p) for p in programs]
    print("| situation | " + " | ".join(name for name, _ in named) + " |")
    print("|---|" + "---|" * len(named))
    for situation in SITUATIONS:
        cells = []
        for _, program in named:
            with tempfile.TemporaryDirectory() as folder:
                right, seen = situation(os.path.abspath(program), folder)
            cells.append(f"{'right' if right else 'WRONG'}: {seen}".replace("|", "/").replace("\n", " "))
        print(f"| {situation.__doc__} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(sys.argv[1:])
