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


def slopes(press):
    """F |dc/dF| at each load, as lumo::load_slopes has it."""
    loads, out = sorted(press), {}
    zero = [0.0] * len(press[loads[0]][2])
    points = [(0.0, zero)] + [(F, press[F][2]) for F in loads]
    rise = [[d / (b[0] - a[0]) for d in difference(b[1], a[1])] for a, b in zip(points, points[1:])]
    for k, F in enumerate(loads):
        slope = rise[k]
        if k + 1 < len(loads):
            before, after = F - points[k][0], loads[k + 1] - F
            slope = [(after * p + before * q) / (before + after) for p, q in zip(rise[k], rise[k + 1])]
        out[F] = F * norm(slope)
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
    print("| edges | states | difference / change: median, 95 % | / (change + slope): median, 95 % | stated: median |"
          " covered |")
    print("|---|---|---|---|---|---|")
    for edges in sorted({e for _, e in presses} - {finest}, reverse=True):
        of_change, of_both, stated, covered = [], [], [], []
        for design in sorted({d for d, e in presses if e == edges}):
            if (design, finest) not in presses:
                continue
            press, fine = presses[design, edges], presses[design, finest]
            slope, fine_slope = slopes(press), slopes(fine)
            for F, (area, noise, change) in press.items():
                fine_area, fine_noise, limit = fine[F]
                sampling = noise**2 + fine_noise**2
                off = norm(difference(change, limit))
                seen = off**2 - sampling
                both = norm(change) + slope[F]
                error = math.hypot(options.area * area * both,
                                   options.area * fine_area * (norm(limit) + fine_slope[F]))
                of_change.append(math.sqrt(max(0.0, seen)) / norm(limit))
                of_both.append(math.sqrt(max(0.0, seen)) / both)
                stated.append(options.area * area)
                covered.append(off <= math.hypot(error, 2.0 * math.sqrt(sampling)))
        print(f"| {edges:g} | {len(stated)} | {statistics.median(of_change):.3f}, {quantile(of_change, 0.95):.3f} | "
              f"{statistics.median(of_both):.3f}, {quantile(of_both, 0.95):.3f} | {statistics.median(stated):.3f} | "
              f"{sum(covered)} of {len(covered)} |")


if __name__ == "__main__":
    main()
