#!/usr/bin/env python3
"""BoTorch beside `lumo optimize`, in short: one problem of benchmarks/optimize, 40 evaluations, a few seeds. The whole
study is benchmarks/optimize/compare.py.

usage: benchmarks/peers/botorch_share.py [--seeds 3] [--evaluations 40] [--problem "smooth lattice"]

Writes botorch.json: shares of the true front's hypervolume, and processor seconds of a proposal, one thread each; seeds
of both take turns.
"""

import argparse
import os
import statistics
import sys

for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ[f"{library}_NUM_THREADS"] = "1"

import measured

sys.path.insert(0, str(measured.HERE.parent / "optimize"))
import compare
import problems


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--evaluations", type=int, default=40)
    parser.add_argument("--problem", default="smooth lattice", choices=list(problems.ALL))
    args = parser.parse_args()
    problem = problems.ALL[args.problem]
    best = problem.best()
    compare.run_botorch(problem, args.seeds, compare.STARTS + 1)  # what is loaded at first use
    shares, seconds = {}, {}
    for seed in range(args.seeds):
        for method in ("botorch", "paper", "default"):
            if method == "botorch":
                _, y, spent = compare.run_botorch(problem, seed, args.evaluations)
            else:
                _, y, spent = compare.run_lumo(problem, seed, method, measured.BUILT / "lumo", args.evaluations)
            shares.setdefault(method, []).append(compare.history(problem, y)[args.evaluations - 1] / best)
            seconds.setdefault(method, []).append(spent / (len(y) - compare.STARTS))
            print(seed, method, shares[method][-1], seconds[method][-1], flush=True)
    measured.keep(
        "botorch",
        {
            "problem": args.problem,
            "evaluations": args.evaluations,
            "starts": compare.STARTS,
            "pool": compare.POOL,
            "shares": shares,
            "seconds": {m: statistics.median(s) for m, s in seconds.items()},
        },
        ["botorch", "gpytorch", "torch", "numpy"],
    )


if __name__ == "__main__":
    main()
