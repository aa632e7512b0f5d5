#!/usr/bin/env python3
"""BoTorch beside `lumo optimize`: the same problems, the same thirteen starts, 256 fresh feasible candidates an
iteration.

usage: benchmarks/optimize/compare.py run METHOD [--lumo build/release/lumo] [--seeds 10] [--problems NAME,…] [--runs
       FILE]
       benchmarks/optimize/compare.py time [--lumo …]
       benchmarks/optimize/compare.py table [--runs FILE]
METHOD: botorch, paper, default. Each run is one line appended to FILE; what is there already is not run again. One
thread each.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import problems

STARTS, EVALUATIONS, POOL = 13, 80, 256


def starts(problem, seed):
    return problem.fresh(np.random.default_rng([seed, 1]), STARTS)


class BoTorch:
    """SingleTaskGP and qLogNEHVI with their defaults, fitted anew at each step."""

    def __init__(self):
        import warnings

        import torch

        warnings.filterwarnings("ignore")
        torch.set_num_threads(1)
        torch.set_default_dtype(torch.double)
        self.torch = torch

    def choose(self, problem, x, y, candidates, seed, prune=True):
        """Index of the candidate to evaluate next; y is maximised. Pruning the baseline is what its tutorials do, not
        its default; it is faster."""
        from botorch.acquisition.multi_objective.logei import qLogNoisyExpectedHypervolumeImprovement
        from botorch.fit import fit_gpytorch_mll
        from botorch.models import SingleTaskGP
        from botorch.sampling.normal import SobolQMCNormalSampler
        from gpytorch.mlls import ExactMarginalLogLikelihood

        torch = self.torch
        torch.manual_seed(seed)
        unit = lambda z: torch.tensor((z - problem.lower) / (problem.upper - problem.lower))
        model = SingleTaskGP(unit(x), torch.tensor(y))
        fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))
        acquisition = qLogNoisyExpectedHypervolumeImprovement(
            model=model,
            ref_point=problem.reference.tolist(),
            X_baseline=unit(x),
            prune_baseline=prune,
            sampler=SobolQMCNormalSampler(torch.Size([128]), seed=seed),
        )
        with torch.no_grad():
            values = torch.cat([acquisition(c.unsqueeze(-2)) for c in unit(candidates).split(64)])
        return int(values.argmax())


def run_botorch(problem, seed, evaluations=EVALUATIONS):
    """Designs, their objectives (maximised), and the processor seconds of fits and acquisitions."""
    peer, rng = BoTorch(), np.random.default_rng([seed, 2])
    asked = [tuple(row) for row in starts(problem, seed)]
    y = problem.evaluate(np.array(asked)) * problem.sign
    seconds = 0.0
    while np.isfinite(y).all(1).sum() < evaluations:
        good = np.isfinite(y).all(1)
        candidates = problem.fresh(rng, POOL, asked)
        begin = time.process_time()
        x = candidates[peer.choose(problem, np.array(asked)[good], y[good], candidates, seed * 1000 + len(asked))]
        seconds += time.process_time() - begin
        asked.append(tuple(x))
        y = np.vstack([y, problem.evaluate(x[None]) * problem.sign])
    return np.array(asked), y, seconds


def run_lumo(problem, seed, source, program, evaluations=EVALUATIONS):
    """The same; the processor seconds are the program's, all that it does."""
    space = problem.space(
        initial=starts(problem, seed).tolist(), sobol=0, evaluations=evaluations, seed=seed, source=source
    )
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        json.dump(space, file)
        file.flush()
        process = subprocess.Popen(
            [program, "optimize", "--space", file.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        x, y = [], []
        for line in process.stdout:
            ask = json.loads(line).get("ask")
            if ask is None:
                break
            value = problem.evaluate(np.array([ask["x"]]))[0]
            x.append(ask["x"])
            y.append(value * problem.sign)
            if np.isfinite(value).all():
                answer = {"tell": {"id": ask["id"], "y": value.tolist()}}
            else:
                answer = {"fail": {"id": ask["id"], "retry": False, "why": "outside the problem's constraints"}}
            process.stdin.write(json.dumps(answer) + "\n")
            process.stdin.flush()
        seconds = cpu_seconds(process.pid)
        process.stdin.close()
        if process.wait() != 0:
            raise RuntimeError(f"lumo optimize ended with {process.returncode}")
    assert problem.feasible(np.array(x)).all() and len({tuple(r) for r in x}) == len(x)
    return np.array(x), np.array(y), seconds


def history(problem, y):
    """Hypervolume after each successful evaluation."""
    good = y[np.isfinite(y).all(1)]
    return [problems.hypervolume(good[: k + 1], problem.reference) for k in range(len(good))]


def read(path):
    try:
        return [json.loads(line) for line in open(path)]
    except FileNotFoundError:
        return []


def run(options):
    names = options.problems.split(",") if options.problems else list(problems.ALL)
    for seed in range(options.first, options.seeds):
        for name in names:
            problem = problems.ALL[name]
            if seed >= (10 if problem.step.any() else 5):
                continue
            if any((r["problem"], r["seed"], r["method"]) == (name, seed, options.method) for r in read(options.runs)):
                continue
            _, y, seconds = (
                run_botorch(problem, seed)
                if options.method == "botorch"
                else run_lumo(problem, seed, options.method, options.lumo)
            )
            trace = history(problem, y)
            row = {
                "problem": name,
                "seed": seed,
                "method": options.method,
                "seconds": round(seconds, 2),
                "failed": int((~np.isfinite(y).all(1)).sum()),
                "hypervolume": [round(v, 9) for v in trace],
            }
            with open(options.runs, "a") as file:
                file.write(json.dumps(row) + "\n")
            print(name, seed, options.method, trace[39], trace[79], f"{seconds:.1f} s", flush=True)


def interval(values, rng):
    """Median and its 95 % percentile bootstrap interval."""
    values = np.array(values)
    medians = np.median(values[rng.integers(0, len(values), (10000, len(values)))], axis=1)
    return np.median(values), np.quantile(medians, 0.025), np.quantile(medians, 0.975)


def table(options):
    rows = {(r["problem"], r["seed"], r["method"]): r["hypervolume"] for r in read(options.runs)}
    cache = pathlib.Path(options.runs).with_suffix(".best.json")
    best = json.loads(cache.read_text()) if cache.is_file() else {}
    rng = np.random.default_rng(0)
    print(
        "| problem | n | method | seeds | BoTorch: share of true front | lumo: share | median difference [95 % interval] | BoTorch's gap closed |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name, problem in problems.ALL.items():
        if name not in best:
            best[name] = problem.best()
            cache.write_text(json.dumps(best))
        for n in (40, 80):
            for method in ("paper", "default"):
                seeds = [s for s in range(10) if (name, s, method) in rows and (name, s, "botorch") in rows]
                if not seeds:
                    continue
                peer, own = ([rows[name, s, m][n - 1] / best[name] for s in seeds] for m in ("botorch", method))
                middle, low, high = interval(np.subtract(own, peer), rng)
                closed = np.median(np.subtract(own, peer) / np.subtract(1, peer))
                print(
                    f"| {name} | {n} | {method} | {len(seeds)} | {np.median(peer):.5f} | {np.median(own):.5f} | {middle:+.5f} [{low:+.5f}, {high:+.5f}] | {100 * closed:z.0f} % |"
                )


def cpu_seconds(pid):
    fields = open(f"/proc/{pid}/stat").read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def time_iteration(options, points=160, repeats=20):
    """Processor time of fit and acquisition over 256 candidates at 160 points and a few more, both in this run, one
    thread each."""
    problem = problems.ALL["worst case"]
    x = problem.fresh(np.random.default_rng(1), points)
    y = problem.evaluate(x) * problem.sign
    peer, rng = BoTorch(), np.random.default_rng(2)
    peer.choose(problem, x[:20], y[:20], problem.fresh(rng, POOL), 0)  # what is compiled or loaded at first use
    theirs = {}
    for prune in (True, False):
        spent, known, values = [], [tuple(r) for r in x], y
        for k in range(repeats // 2):
            candidates = problem.fresh(rng, POOL, known)
            begin = time.process_time()
            chosen = candidates[peer.choose(problem, np.array(known), values, candidates, k, prune)]
            spent.append(time.process_time() - begin)
            known.append(tuple(chosen))
            values = np.vstack([values, problem.evaluate(chosen[None]) * problem.sign])
        theirs[prune] = np.median(spent)
        print(
            f"BoTorch, baseline {'pruned' if prune else 'not pruned (its default)'}: {1e3 * theirs[prune]:.1f} ms an iteration at {points} to {points + repeats // 2 - 1} points"
        )
    for source in ("paper", "default"):
        space = problem.space(initial=x.tolist(), sobol=0, evaluations=points + repeats + 1, seed=1, source=source)
        with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
            json.dump(space, file)
            file.flush()
            process = subprocess.Popen(
                [options.lumo, "optimize", "--space", file.name],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                bufsize=1,
            )
            for k in range(points + repeats):
                ask = json.loads(process.stdout.readline())["ask"]
                if k == points:
                    begin = cpu_seconds(process.pid)  # the first proposal has been made
                process.stdin.write(
                    json.dumps({"tell": {"id": ask["id"], "y": problem.evaluate(np.array([ask["x"]]))[0].tolist()}})
                    + "\n"
                )
                process.stdin.flush()
            process.stdout.readline()
            own = (cpu_seconds(process.pid) - begin) / repeats
            process.kill()
            process.wait()
        print(
            f"lumo, {source}: {1e3 * own:.1f} ms at {points + 1} to {points + repeats} points: 1/{theirs[True] / own:.1f} of BoTorch pruned, 1/{theirs[False] / own:.1f} not pruned"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("command", choices=["run", "time", "table"])
    parser.add_argument("method", nargs="?", choices=["botorch", "paper", "default"])
    parser.add_argument("--lumo", default="build/release/lumo")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--problems", default="")
    parser.add_argument("--runs", default=str(pathlib.Path(__file__).parent / "runs.jsonl"))
    arguments = parser.parse_args()
    {"run": run, "table": table, "time": time_iteration}[arguments.command](arguments)
