#!/usr/bin/env python3
"""Markdown tables from the lines that lumo_refinement wrote: how objectives, their terms and depths move with mesh size
and ray count, how often the printed errors cover that, and whether the ranking of designs stays.
usage: benchmarks/refinement/table.py FILE [--base default]"""

import argparse
import collections
import json
import statistics


def kendall(a, b):
    """Kendall's tau-a of two equally long lists."""
    pairs = [(i, j) for i in range(len(a)) for j in range(i)]
    sign = lambda x: (x > 0) - (x < 0)
    return sum(sign(a[i] - a[j]) * sign(b[i] - b[j]) for i, j in pairs) / len(pairs)


def read(path):
    """Lines by material and contacts, then by setting, then by design."""
    studies = collections.defaultdict(lambda: collections.defaultdict(dict))
    for line in open(path):
        row = json.loads(line)
        setting, material, contacts, design = row["key"].split()
        studies[f"{material}, {contacts.replace(';', ', ')} mm"][setting][design] = row
    return studies


def ratios(base, other, name, first=0):
    """Relative differences in every state from the given one on."""
    for a, b in zip(base["scenarios"], other["scenarios"]):
        for x, y in zip(a[name][first:], b[name][first:]):
            yield x / y - 1


def terms(base, other, name):
    for a, b in zip(base["scenarios"], other["scenarios"]):
        if a[name] and b[name]:
            yield a[name][0] - b[name][0]


def row(name, values, percent):
    values = sorted(abs(v) for v in values)
    if not values:
        return f"| {name} | – | – |"
    show = (lambda v: f"{100 * v:.2f} %") if percent else (lambda v: f"{v:.4f}")
    return f"| {name} | {show(statistics.median(values))} | {show(values[-1])} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--base", default="default")
    arguments = parser.parse_args()
    for study, settings in sorted(read(arguments.file).items()):
        base = settings.get(arguments.base, {})
        for name, rows in sorted(settings.items()):
            both = [d for d in base if d in rows and base[d]["J_contact"] and rows[d]["J_contact"]]
            if name == arguments.base or not both:
                continue
            pairs = [(base[d], rows[d]) for d in both]
            print(
                f"\n### {study}: `{arguments.base}` against `{name}`, {len(both)} designs\n\n| difference | median | largest |\n|---|---|---|"
            )
            print(row("depth", [v for p in pairs for v in ratios(*p, "depth_mm")], True))
            print(
                row(
                    "area of contact, from the second load on",
                    [v for p in pairs for v in ratios(*p, "area_mm2", 1)],
                    True,
                )
            )
            for term in ("q_form", "q_stable", "q_stiff", "score"):
                print(
                    row(
                        "J of a scenario" if term == "score" else term,
                        [v for p in pairs for v in terms(*p, term)],
                        False,
                    )
                )
            print(row("J_contact", [a["J_contact"][0] - b["J_contact"][0] for a, b in pairs], False))
            print(row("J_obs", [a["J_obs"][0] / b["J_obs"][0] - 1 for a, b in pairs], True))
            for objective in ("J_contact", "J_obs"):
                covered = sum(abs(a[objective][0] - b[objective][0]) <= a[objective][1] for a, b in pairs)
                line = f"\n{objective}: the printed error covers {covered} of {len(pairs)}"
                if len(pairs) > 2:
                    line += f"; Kendall τ of the ranking {kendall([a[objective][0] for a, _ in pairs], [b[objective][0] for _, b in pairs]):.3f}"
                print(line + ".")
            print(
                f"\nNodes of the largest mesh, median: {statistics.median(a['nodes'] for a, _ in pairs):.0f} and {statistics.median(b['nodes'] for _, b in pairs):.0f}; "
                f"core-seconds of mechanics {statistics.median(a['seconds'][1] for a, _ in pairs):.0f} and {statistics.median(b['seconds'][1] for _, b in pairs):.0f}, "
                f"of optics {statistics.median(a['seconds'][2] for a, _ in pairs):.0f} and {statistics.median(b['seconds'][2] for _, b in pairs):.0f}."
            )


main()
