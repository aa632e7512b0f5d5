#!/usr/bin/env python3
"""Puts what lumo_absorption found into the page about absorption.

usage: benchmarks/absorption/page.py FOLDER    (that program's; its tables are copied beside this script, its pictures
       beside the page)

Rows are assumptions of one body; DS : Sol compares the strongest part of its change with that of Solaris of which all
is absorbed, as the paper has it.
"""

import csv
import pathlib
import shutil
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import pages

PAGE = HERE.parents[1] / "docs/pages/absorption.md"
BEGIN, END = "<!-- found: made by benchmarks/absorption/page.py -->\n", "<!-- found: end -->\n"
BODIES = ["plain", "built-dry", "built-wet"]


def number(text, digits, sign=False):
    return f"{float(text):{'+' if sign else ''}.{digits}f}".replace("-", "−")


def absorbed(row):
    if row["absorbed_per_m"] == "all":
        return "all (71)" if row["silicone"] == "DS" else "all (15)", "–"
    return row["absorbed_per_m"], number(row["g"], 1)


def table(rows):
    lines = [
        "| body | silicone | absorbed [1/m] | g | side light at rest [%] | change on an LED [%] | between LEDs [%] | "
        "sign | peak/far | DS : Sol | J_obs [1e-5] | time to the clear one's |",
        "|" + "---|" * 12,
    ]
    for body in BODIES:
        here = [r for r in rows if r["body"] == body]
        sol = [float(r["peak"]) for r in here if r["silicone"] == "Sol" and r["absorbed_per_m"] == "all"]
        for r in here:
            amount, g = absorbed(r)
            on, between = float(r["on_led"]), float(r["between"])
            sign = "brighter" if min(on, between) > 0 else "darker" if max(on, between) < 0 else "both"
            ratio = f"{float(r['peak']) / sol[0]:.2f}" if sol and r["silicone"] == "DS" else "–"
            lines.append(
                f"| {body} | {r['silicone']} | {amount} | {g} | {number(100 * float(r['rest']), 2)} | "
                f"{number(100 * on, 0, True)} | {number(100 * between, 0, True)} | {sign} | "
                f"{number(r['peak_over_far'], 1)} | {ratio} | {number(1e5 * float(r['J_obs']), 2)} ± "
                f"{number(1e5 * float(r['J_obs_err']), 2)} | {number(r['cpu_over_clear'], 2)} |"
            )
    return lines


def main(folder):
    rows = []
    for body in ("plain", "built"):
        if not (folder / f"{body}.csv").exists():  # not run yet
            continue
        shutil.copy(folder / f"{body}.csv", HERE / f"{body}.csv")
        with open(folder / f"{body}.csv", encoding="utf-8", newline="") as file:
            rows += csv.DictReader(file)
    for name in (body.replace("-", "_") for body in BODIES):
        for place in ("on_led", "between"):
            picture = folder / f"{name}_{place}.svg"
            if picture.exists():
                shutil.copy(picture, PAGE.parent / f"absorption_{name}_{place}.svg")
    pages.replace_part(PAGE, BEGIN, END, "\n" + "\n".join(table(rows)) + "\n\n")


if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    main(pathlib.Path(sys.argv[1]))
