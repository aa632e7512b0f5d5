#!/usr/bin/env python3
"""Puts what `lumo study readings` found into the page that says what the paper leaves open.

usage: benchmarks/assumptions/table.py FOLDER plain|built    (the study's --out, and the finger that it was run with;
       tables and pictures are copied beside this script and beside the page, those of the built finger as …_built.…)

The page's part between the finger's two markers is written anew: a row for each assumption, largest change of J_obs
first, and the assumptions under which a ranking changes.
"""

import csv
import pathlib
import shutil
import sys
import textwrap

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import pages

PAGE = HERE.parents[1] / "docs/pages/assumptions.md"
BEGIN = "<!-- found, {} finger: made by benchmarks/assumptions/table.py -->\n"
END = "<!-- found, {} finger: end -->\n"
WEAK = 0.8  # Kendall's tau below which conclusions depend on an assumption, as the program says


def number(text, digits):
    return (f"{float(text):+.{digits}f}" if float(text) else "0").replace("-", "−") if text else "–"


def change(row, key, digits):
    low, high = row[f"{key}_low"], row[f"{key}_high"]
    return number(row[key], digits) + (f" ({number(low, digits)} … {number(high, digits)})" if low else "")


def tau(text):
    if not text:
        return "–"
    shown = f"{float(text):.2f}".replace("-", "−")
    return f"**{shown}**" if float(text) < WEAK else shown


def share(row, key):
    return f"{row[key]} of {row['designs']}"


def table(rows):
    lines = [
        "| assumption | designs | ΔJ_contact: median (95 %) | ΔJ_obs [%]: median (95 %) | τ, J_contact | "
        "τ, J_obs | other contact decides J_contact | J_obs | i* |",
        "|" + "---|" * 9,
    ]
    for row in sorted(rows, key=lambda r: -abs(float(r["delta_J_obs_percent"] or 0.0))):
        name = f"{row['quantity']}: {row['value']}".replace("|", "\\|")
        choice = "stays" if row["choice_mm"] == row["usual_choice_mm"] else row["choice_mm"] or "–"
        designs = row["designs"] + (f" ({row['lost']} lost)" if row["lost"] != "0" else "")
        lines.append(
            f"| {name} | {designs} | {change(row, 'delta_J_contact', 4)} | "
            f"{change(row, 'delta_J_obs_percent', 1)} | {tau(row['tau_J_contact'])} | "
            f"{tau(row['tau_J_obs'])} | {share(row, 'worst_contact_moved')} | "
            f"{share(row, 'worst_observation_moved')} | {choice} |"
        )
    return lines


def weak(rows):
    lines = []
    for key, objective in (("tau_J_contact", "J_contact"), ("tau_J_obs", "J_obs")):
        weakest = sorted((r for r in rows if r[key] and float(r[key]) < WEAK), key=lambda r: float(r[key]))
        names = [f"{r['quantity']} ({r['value']}), τ {float(r[key]):.2f}" for r in weakest]
        names = [name.replace("|", "\\|").replace("τ -", "τ −") for name in names]
        text = f"- The ranking by {objective} changes (τ below {WEAK}) under: {'; '.join(names) if names else 'none'}."
        lines += textwrap.wrap(text, 120, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
    return lines


def main(folder, finger):
    ending = "" if finger == "plain" else f"_{finger}"
    for name in ("study_readings", "study_readings_designs"):
        shutil.copy(folder / f"{name}.csv", HERE / f"{name}{ending}.csv")
    for name in ("study_readings_J_contact", "study_readings_J_obs"):
        shutil.copy(folder / f"{name}.svg", PAGE.parent / f"{name}{ending}.svg")
    with open(folder / "study_readings.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    found = "\n".join([*table(rows), "", *weak(rows), ""])
    pages.replace_part(PAGE, BEGIN.format(finger), END.format(finger), "\n" + found + "\n")


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[2] not in ("plain", "built"):
        sys.exit(__doc__)
    main(pathlib.Path(sys.argv[1]), sys.argv[2])
