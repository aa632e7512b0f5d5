#!/usr/bin/env python3
"""Markdown tables from the lines that lumo_observations wrote: Kendall's tau between J_obs by each pair of observations,
with its standard error by the bootstrap over designs, and how many responses are bright and dark.
usage: benchmarks/observations/table.py FILE"""

import itertools
import json
import random
import statistics
import sys

OBSERVATIONS = ("side", "camera", "photodiodes")


def kendall(a, b):
    """Kendall's tau-b of two equally long lists; None if one of them ties all."""
    sign = lambda x: (x > 0) - (x < 0)
    agreed = apart_a = apart_b = 0
    for i, j in itertools.combinations(range(len(a)), 2):
        x, y = sign(a[i] - a[j]), sign(b[i] - b[j])
        agreed += x * y
        apart_a += x != 0
        apart_b += y != 0
    return agreed / (apart_a * apart_b) ** 0.5 if apart_a and apart_b else None


def tau_with_error(a, b, draws=400):
    chance = random.Random(1)
    taus = []
    for _ in range(draws):
        k = [chance.randrange(len(a)) for _ in a]
        tau = kendall([a[i] for i in k], [b[i] for i in k])
        if tau is not None:
            taus.append(tau)
    return kendall(a, b), statistics.stdev(taus)


def main():
    rows = [json.loads(line) for line in open(sys.argv[1])]
    scored = [r for r in rows if all(r.get(o, {}).get("J_obs") for o in OBSERVATIONS)]
    print(f"{len(rows)} designs, {len(scored)} with J_obs by every observation.\n")
    print("| observations | Kendall τ of J_obs |\n|---|---|")
    for a, b in itertools.combinations(OBSERVATIONS, 2):
        if len(scored) > 2:
            tau, error = tau_with_error(*([r[o]["J_obs"][0] for r in scored] for o in (a, b)))
            print(f"| {a}, {b} | {tau:.2f} ± {error:.2f} |")
    print("\n| observation | bright | dark | neither | designs mostly dark | J_obs error, median |\n|---|---|---|---|---|---|")
    for o in OBSERVATIONS:
        lit = [r[o] for r in rows if o in r]
        bright, dark, neither = (sum(r[k] for r in lit) for k in ("bright", "dark", "undecided"))
        every = max(1, bright + dark + neither)
        error = [r["J_obs"][1] / r["J_obs"][0] for r in lit if r["J_obs"] and r["J_obs"][0] > 0]
        print(
            f"| {o} | {100 * bright / every:.0f} % | {100 * dark / every:.0f} % | {100 * neither / every:.0f} % | "
            f"{sum(r['dark'] > r['bright'] for r in lit)} of {len(lit)} | "
            f"{100 * statistics.median(error) if error else float('nan'):.0f} % |"
        )


main()
