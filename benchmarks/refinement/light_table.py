#!/usr/bin/env python3
"""Markdown table from the lines that lumo_light_refinement wrote: how far changes of light are from those on the finest
mesh, as parts of what OpticalError takes them for, and how many it covers.
usage: benchmarks/refinement/light_table.py FILE [--area 2.0]"""

import argparse
import collections
import csv
import math
import statistics

REGIONS_FROM = 13


def read(path):
    """(design, edges) -> load -> (area error, noise, change)"""
    presses = collections.defaultdict(dict)
    for row in csv.reader(open(path)):
        change = [float(v) for v in row[REGIONS_FROM:]]
        presses[int(row[0]), float(row[8])][float(row[9])] = float(row[11]), float(row[12]), change
    return presses


def norm(v):
    return math.hypot(*v)


def difference(a, b):
    return [x - y for x, y in zip(a, b)]


def rises(press):
    """F |change of c|/change of F at each load, as lumo::load_rises has it."""
    loads, out = sorted(press), {}
    before, last = 0.0, [0.0] * len(press[loads[0]][2])
    for F in loads:
        out[F] = F * norm(difference(press[F][2], last)) / (F - before)
        before, last = F, press[F][2]
    return out


def quantile(values, q):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, math.ceil(q * len(ordered)) - 1)]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file")
    parser.add_argument("--area", type=float, default=2.0)
    options = parser.parse_args()
    presses = read(options.file)
    finest = min(edges for _, edges in presses)
    print("| edges | states | difference / change: median, 95 % | / (change + rise): median, 95 % | stated: median |"
          " covered |")
    print("|---|---|---|---|---|---|")
    for edges in sorted({e for _, e in presses} - {finest}, reverse=True):
        of_change, of_both, stated, covered = [], [], [], []
        for design in sorted({d for d, e in presses if e == edges}):
            if (design, finest) not in presses:
                continue
            press, fine = presses[design, edges], presses[design, finest]
            rise, fine_rise = rises(press), rises(fine)
            for F, (area, noise, change) in press.items():
                fine_area, fine_noise, limit = fine[F]
                sampling = noise**2 + fine_noise**2
                off = norm(difference(change, limit))
                seen = off**2 - sampling
                both = norm(change) + rise[F]
                error = math.hypot(options.area * area * both,
                                   options.area * fine_area * (norm(limit) + fine_rise[F]))
                of_change.append(math.sqrt(max(0.0, seen)) / norm(limit))
                of_both.append(math.sqrt(max(0.0, seen)) / both)
                stated.append(options.area * area)
                covered.append(off <= math.hypot(error, 2.0 * math.sqrt(sampling)))
        print(f"| {edges:g} | {len(stated)} | {statistics.median(of_change):.3f}, {quantile(of_change, 0.95):.3f} | "
              f"{statistics.median(of_both):.3f}, {quantile(of_both, 0.95):.3f} | {statistics.median(stated):.3f} | "
              f"{sum(covered)} of {len(covered)} |")


if __name__ == "__main__":
    main()
