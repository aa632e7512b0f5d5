"""The virtual lab and the commands that read logs, from outside: files, JSON keys, exit codes, one line for every
error. Coarse responses: nothing here is about accuracy.

usage: test_lab.py path/to/lumo
"""

import csv
import json
import math
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

from refusal import check_refusal

LUMO = ""
USAGE, INFEASIBLE, BAD_FILE = 2, 3, 5


PLAIN = ["--finger", "plain"]  # pressed in a fraction of the time


def run(*arguments, **options):
    return subprocess.run(
        [LUMO, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=options.pop("timeout", 900),
        env=dict(os.environ, LC_ALL="C"),
        **options,
    )


def rows_of(path):
    with open(path, newline="") as table:
        return list(csv.DictReader(table))


class Lab(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp())
        for kind in ["recontact", "cycle", "imaging", "force", "hand"]:
            done = run(
                "lab",
                kind,
                *PLAIN,
                "--coarse",
                "--quiet",
                "--json",
                "--seed",
                1,
                "--out",
                cls.folder / kind,
                "--cache",
                cls.folder / "cache",
            )
            assert done.returncode == 0, done.stderr
            setattr(cls, kind, json.loads(done.stdout))

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def refused(self, code, words, *arguments):
        check_refusal(self, run(*arguments), code, words)

    def result(self, *arguments):
        done = run(*arguments, "--json", "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout)

    def test_files(self):
        log = self.folder / "force"
        self.assertEqual(
            sorted(p.name for p in log.iterdir()),
            ["frames", "frames.csv", "joint.csv", "marker.csv", "session.json", "truth.csv", "wrench.csv"],
        )
        rows = rows_of(log / "frames.csv")
        truth = rows_of(log / "truth.csv")
        self.assertEqual(len(rows), self.force["frames"])
        self.assertEqual([r["stamp_ns"] for r in rows], [r["stamp_ns"] for r in truth])
        self.assertTrue(all((log / "frames" / r["file"]).is_file() for r in rows))
        self.assertGreaterEqual(self.force["contact_frames"], 931)  # as many as the paper's
        self.assertNotIn("truth", (log / "session.json").read_text())
        self.assertEqual(len(list((self.folder / "cache").iterdir())), 1)  # one pad, computed once

    def test_same_seed_same_log(self):
        for seed, same in [(1, True), (2, False)]:
            out = self.folder / f"again{seed}"
            self.assertEqual(
                run(
                    "lab",
                    "force",
                    *PLAIN,
                    "--coarse",
                    "--quiet",
                    "--seed",
                    seed,
                    "--out",
                    out,
                    "--cache",
                    self.folder / "cache",
                ).returncode,
                0,
            )
            for name in ["joint.csv", "truth.csv", "frames/000500.png"]:
                self.assertEqual((out / name).read_bytes() == (self.folder / "force" / name).read_bytes(), same, name)

    def test_a_localiser_that_knows_its_pad(self):
        pad = next((self.folder / "cache").iterdir())
        alone = self.result("locate", "--pad", pad)
        self.assertEqual(alone["responses"], str(pad))
        self.assertIn(alone["insensible"], [True, False])
        self.assertEqual([a["load_N"] for a in alone["at"]], [2, 5])
        log = self.folder / "force"
        with_pad = self.result("locate", log, "--pad", pad, "--out", self.folder / "by_pad")
        self.assertEqual(with_pad["pad"]["insensible"], alone["insensible"])
        frames = with_pad["frames"]
        self.assertEqual(frames["estimated"], frames["touched"] + frames["free"] + frames["unknown_response"])
        self.assertTrue(all(r["unknown"] in ["0", "1"] for r in rows_of(self.folder / "by_pad" / "locations.csv")))
        by_log = self.result("locate", log, "--calibration", self.folder / "recontact")
        self.assertTrue(by_log["pad"]["recorded"])
        self.assertIsNone(by_log["pad"]["insensible"])
        self.assertGreater(by_log["located"], 0.5 * by_log["samples"])
        self.assertLess(by_log["mae_mm"], 3.0)  # the log presses where the calibration did
        force = self.result("force", log, "--calibration", self.folder / "recontact")
        self.assertGreater(force["samples"], 0)
        self.refused(USAGE, "give one of them", "locate", log, "--pad", pad, "--calibration", log)
        self.refused(USAGE, "not for --localizer peak", "locate", log, "--pad", pad, "--localizer", "peak")
        self.refused(BAD_FILE, "no such file", "locate", log, "--pad", self.folder / "none.txt")
        self.refused(BAD_FILE, "holds no responses of a pad", "force", log, "--pad", log / "session.json")

    def test_damaged_cache_is_told_and_computed_anew(self):
        cache = self.folder / "damaged"
        shutil.copytree(self.folder / "cache", cache)
        file = next(cache.iterdir())
        text = file.read_text()
        file.write_text(text.replace("unloaded 60", "unloaded 61"))
        done = run("lab", "force", *PLAIN, "--coarse", "--out", self.folder / "after", "--cache", cache)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("damaged", done.stderr)
        self.assertEqual(file.read_text(), text)  # same responses, to the bit

    def test_an_interrupt_leaves_nothing(self):
        target = self.folder / "stopped"
        lab = subprocess.Popen(
            [LUMO, "lab", "recontact", *PLAIN, "--coarse", "--cache", self.folder / "cache", "--out", target],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        until = time.monotonic() + 300
        while not list(self.folder.glob("stopped.part-*/frames/*")) and time.monotonic() < until:
            time.sleep(0.01)
        lab.send_signal(signal.SIGINT)
        _, said = lab.communicate(timeout=60)
        self.assertEqual(lab.returncode, 130, said)
        self.assertEqual(list(self.folder.glob("stopped*")), [])

    def test_decode(self):
        for decoder in ["linear", "gp", "bayes"]:
            with self.subTest(decoder=decoder):
                other = self.result("decode", self.folder / "recontact", "--decoder", decoder)
                self.assertGreaterEqual(other["accuracy"], 0.9)
                self.assertEqual(len(other["predictions"]), 30)
        r = self.result("decode", self.folder / "recontact", "--out", self.folder / "d")
        self.assertEqual(set(r), {"accuracy", "confusion", "predictions", "log"})
        self.assertEqual(sum(map(sum, r["confusion"])), 30)
        self.assertEqual(len(r["predictions"]), 30)
        right = sum(r["confusion"][i][i] for i in range(6))
        self.assertAlmostEqual(r["accuracy"], right / 30)
        self.assertEqual(sorted(p.name for p in (self.folder / "d").iterdir()), ["confusion.svg", "predictions.csv"])

    def test_metrics(self):
        r = self.result("metrics", self.folder / "recontact")
        self.assertEqual(
            list(r),
            [
                "D_neighbor",
                "W_recontact",
                "Q",
                "Q_low",
                "Q_high",
                "Q_bootstrap_low",
                "Q_bootstrap_high",
                "W_cycle_DN",
                "cycles",
                "gain_percent",
                "log",
            ],
        )
        self.assertAlmostEqual(r["Q"], r["D_neighbor"] / r["W_recontact"])
        self.assertLessEqual(r["Q_low"], r["Q"])
        self.assertGreaterEqual(r["Q_high"], r["Q"])
        self.assertLess(r["Q_bootstrap_low"], r["Q_bootstrap_high"])
        self.assertIsNone(r["W_cycle_DN"])
        self.assertEqual(r["cycles"], {"runs": 0, "runs_lost": 0, "from_N": None, "to_N": None})
        self.assertIsNone(r["gain_percent"])
        cycle = self.result("metrics", self.folder / "cycle", "--baseline", self.folder / "cycle")
        self.assertGreater(cycle["W_cycle_DN"], 0.0)
        self.assertLess(cycle["W_cycle_DN"], 2.0)  # noise of frames and relaxation: below what one press changes
        self.assertEqual(cycle["cycles"], {"runs": 9, "runs_lost": 0, "from_N": 3.0, "to_N": 14.0})
        segments = json.loads((self.folder / "cycle" / "session.json").read_text())["segments"]
        numbers = [s["cycle"] for s in segments if s["kind"] == "cycle"]
        self.assertEqual(numbers, 9 * [-2, -1, 0, 1, 2, 3, 4])  # two for conditioning
        self.assertAlmostEqual(cycle["gain_percent"], 0.0)  # against itself
        imaging = self.result("metrics", self.folder / "imaging", "--out", self.folder / "m")
        self.assertGreater(imaging["Q"], 0.0)
        self.assertEqual(
            {(row["place"], row["repetition"]) for row in rows_of(self.folder / "m" / "slopes.csv")},
            {(str(p), str(v)) for p in range(3) for v in range(7)},
        )

    def test_locate(self):
        out = self.folder / "l"
        r = self.result("locate", self.folder / "force", "--out", out)
        self.assertEqual(
            list(r), ["samples", "mae_mm", "coverage_90", "located", "frames", "contacts", "log"]
        )
        self.assertGreater(r["samples"], 500)
        self.assertEqual(sorted(p.name for p in out.iterdir()), ["locations.csv", "locations.svg", "overlay.png"])
        rows = rows_of(out / "locations.csv")
        errors = [
            abs(float(x["y_mm"]) - float(x["true_y_mm"]))
            for x in rows
            if x["y_mm"] and x["true_y_mm"] and float(x["true_force_N"]) >= 5
        ]
        self.assertAlmostEqual(sum(errors) / len(errors), r["mae_mm"], places=9)  # by another hand

    def test_force(self):
        out = self.folder / "f"
        r = self.result("force", self.folder / "force", "--out", out)
        self.assertEqual(
            list(r),
            [
                "samples",
                "mae_N",
                "alpha",
                "coverage_90",
                "frame_ms",
                "alignment",
                "latency",
                "samples_of",
                "frames",
                "contacts",
                "log",
            ],
        )
        self.assertGreater(r["alignment"]["torque_Nm"], 0.05)  # what the rig's current sensor scatters by, and more
        self.assertLess(r["alignment"]["torque_Nm"], 0.15)
        self.assertEqual(list(r["mae_N"]), ["fused", "optical", "fixed_arm", "known_location", "torque_only"])
        self.assertIsNone(r["mae_N"]["torque_only"])  # one joint does not tell
        self.assertGreater(r["mae_N"]["fixed_arm"], r["mae_N"]["known_location"])
        self.assertEqual(r["alpha"]["of_mae_N"], {"alpha": 1.0, "fitted_on_sequence": None})
        left_out = r["alpha"]["one_left_out"]
        sequences = left_out["sequences"]
        self.assertEqual([s["sequence"] for s in sequences], list(range(6)))  # one for each place
        self.assertEqual(sum(s["samples"] for s in sequences), r["samples"])
        self.assertAlmostEqual(
            left_out["mae_out_of_sample_N"],
            sum(s["samples"] * s["mae_out_of_sample_N"] for s in sequences) / r["samples"],
        )
        for k in [0, 4]:
            one = self.result("force", self.folder / "force", "--alpha-from", k)["alpha"]["one_sequence"]
            self.assertEqual(one["fitted_on_sequence"], k)
            self.assertEqual(one["alpha"], sequences[k]["alpha"])
            share = sequences[k]["samples"] / r["samples"]  # its own samples are in the one and not in the other
            self.assertAlmostEqual(
                one["mae_in_sample_N"],
                share * sequences[k]["mae_in_sample_N"] + (1 - share) * one["mae_without_it_N"],
            )
        self.refused(
            USAGE, ["--alpha-from is 6", "no sequence"], "force", self.folder / "force", "--alpha-from", 6, "--quiet"
        )
        rows = rows_of(out / "forces.csv")
        for row in rows:
            for key in ["force_N", "force_sigma_N", "y_mm"]:
                self.assertTrue(row[key] == "" or math.isfinite(float(row[key])))

    def test_two_joints_tell_the_place_by_their_torques(self):
        log = self.folder / "two"
        done = run(
            "lab",
            "force",
            *PLAIN,
            "--coarse",
            "--quiet",
            "--joints",
            2,
            "--noise",
            0.5,
            "--out",
            log,
            "--cache",
            self.folder / "cache",
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(json.loads((log / "session.json").read_text())["joint_to_joint_mm"], [45.0])
        r = self.result("force", log)
        self.assertIsNotNone(r["mae_N"]["torque_only"])
        self.assertGreater(r["mae_N"]["torque_only"], r["mae_N"]["known_location"])  # a quotient of two noisy torques
        self.assertLess(r["mae_N"]["known_location"], r["mae_N"]["fixed_arm"])
        session = json.loads((log / "session.json").read_text())
        session["joint_to_joint_mm"] = []
        (log / "session.json").write_text(json.dumps(session))
        self.refused(BAD_FILE, ["joint_to_joint_mm", "1 joint", "2"], "force", log, "--quiet")

    def test_hand(self):
        log, out = self.folder / "hand", self.folder / "h"
        self.assertEqual(
            sorted(p.name for p in log.iterdir()), ["frames", "frames.csv", "joint.csv", "session.json", "truth.csv"]
        )
        r = self.result("hand", log, "--out", out)
        self.assertEqual(list(r), ["frames", "references", "links", "score", "contacts", "log"])
        self.assertEqual(r["frames"] + r["references"], self.hand["frames"])
        self.assertEqual(
            [link["name"] for link in r["links"]], ["left proximal", "left distal", "right proximal", "right distal"]
        )
        self.assertTrue(all(link["seen"] > 0.98 * r["frames"] for link in r["links"]))
        rows = rows_of(out / "contacts.csv")
        self.assertEqual(
            [(row["stamp_ns"], row["link"]) for row in rows],
            [(str(c["stamp_ns"]), str(c["link"])) for c in r["contacts"]],
        )
        truth, found, errors = {}, 0, []
        for row in rows_of(log / "truth.csv"):
            truth.setdefault(row["stamp_ns"], []).append(row)
        touches = [
            t
            for rows in truth.values()
            for t in rows
            if float(t["force_N"]) >= 5 and int(t["stamp_ns"]) >= min(int(c["stamp_ns"]) for c in r["contacts"])
        ]
        for t in touches:
            off = [
                abs(float(row["y_mm"]) - float(t["y_mm"]))
                for row in rows
                if (row["stamp_ns"], row["link"]) == (t["stamp_ns"], t["link"])
            ]
            if off and min(off) <= 8:
                errors.append(min(off))
        self.assertEqual((r["score"]["touches"], r["score"]["found"]), (len(touches), len(errors)))  # by another hand
        self.assertAlmostEqual(r["score"]["mae_mm"], sum(errors) / len(errors), places=9)
        self.assertGreater(len(errors), 0.9 * len(touches))
        near = lambda row: any(
            row["link"] == t["link"] and abs(float(row["y_mm"]) - float(t["y_mm"])) <= 8
            for t in truth.get(row["stamp_ns"], [])
        )
        self.assertEqual(
            r["score"]["unfounded"], sum(not near(row) for row in rows)
        )  # coarse light has bumps of its own: nothing is said of how many
        pictures = sorted(p.name for p in out.iterdir())
        self.assertEqual(pictures[-2:], ["contacts.csv", "contacts.svg"])
        self.assertEqual(pictures[:-2], [f"contact_{k:03d}.png" for k in range(len(pictures) - 2)])
        self.assertGreaterEqual(len(pictures) - 2, 12)  # twelve grasps
        self.result("convert", log, self.folder / "hand.mcap")
        self.assertEqual(self.result("hand", self.folder / "hand.mcap"), r)
        bare = self.folder / "no_truth"
        shutil.copytree(log, bare)
        os.remove(bare / "truth.csv")
        blind = self.result("hand", bare)
        self.assertIsNone(blind["score"])
        self.assertEqual(blind["contacts"], r["contacts"])
        session = json.loads((bare / "session.json").read_text())
        session["segments"] = [s for s in session["segments"] if s["kind"] != "free"]
        (bare / "session.json").write_text(json.dumps(session))
        self.refused(BAD_FILE, ["no_truth", "unloaded hand"], "hand", bare, "--quiet")
        os.remove(bare / "joint.csv")
        self.refused(BAD_FILE, ["no_truth", "joint"], "hand", bare, "--quiet")
        self.refused(BAD_FILE, ["session.json", "links"], "hand", self.folder / "force", "--quiet")

    def test_calibrate(self):
        r = self.result("calibrate", self.folder / "imaging", "--coarse", "--cache", self.folder / "cache")
        self.assertEqual(
            list(r), ["mu_Pa", "onset_mm", "residual_N", "gain_DN_per_electron", "lamps_DN", "lamps_electrons"]
        )
        self.assertAlmostEqual(
            r["mu_Pa"]["value"] / 98500, 1.0, delta=0.08
        )  # the rig presses the nominal pad; it creeps, and its place scatters
        self.assertLess(r["mu_Pa"]["low"], r["mu_Pa"]["value"])
        self.assertAlmostEqual(r["gain_DN_per_electron"]["value"], 0.03, delta=0.006)
        other = self.folder / "specimen"
        done = run(
            "lab",
            "imaging",
            *PLAIN,
            "--coarse",
            "--quiet",
            "--stiffness",
            1.15,
            "--lamps",
            0.8,
            "--out",
            other,
            "--cache",
            self.folder / "cache",
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        s = self.result("calibrate", other, "--coarse", "--cache", self.folder / "cache")  # the same noise, another pad
        self.assertAlmostEqual(s["mu_Pa"]["value"] / r["mu_Pa"]["value"], 1.15, delta=0.02)
        self.assertAlmostEqual(s["lamps_DN"] / r["lamps_DN"], 0.8, delta=0.01)
        self.assertAlmostEqual(s["gain_DN_per_electron"]["value"], 0.03, delta=0.006)
        self.refused(USAGE, ["--stiffness", "[0.8, 2]"], "lab", "imaging", "--stiffness", 3, "--out", self.folder / "x")
        self.refused(USAGE, ["--stiffness", "20 N"], "lab", "force", "--stiffness", 0.9, "--out", self.folder / "x")
        self.refused(
            BAD_FILE,
            ["force", '"dark"'],
            "calibrate",
            self.folder / "force",
            *PLAIN,
            "--coarse",
            "--quiet",
            "--cache",
            self.folder / "cache",
        )

    def test_an_mcap_file_is_the_same_log(self):
        for kind, commands in [
            ("recontact", ["decode", "metrics", "locate"]),
            ("cycle", ["metrics"]),
            ("force", ["locate", "force"]),
            ("imaging", ["calibrate"]),
        ]:
            file = self.folder / f"{kind}.mcap"
            result = self.result("convert", self.folder / kind, file)
            self.assertEqual(
                (result["frames"], result["truth"], result["fault"]), (getattr(self, kind)["frames"], True, None)
            )
            self.assertEqual(
                (self.folder / f"{kind}.truth.csv").read_bytes(), (self.folder / kind / "truth.csv").read_bytes()
            )
            for command in commands:
                more = ["--coarse", "--cache", self.folder / "cache"] if command == "calibrate" else []
                results = [self.result(command, log, *more) for log in (self.folder / kind, file)]
                for r in results:
                    r.pop("frame_ms", None)  # the clock's
                self.assertEqual(*results, f"{command} {kind}")
        back = self.folder / "back"
        self.result("convert", self.folder / "cycle.mcap", back)
        for there in (self.folder / "cycle").rglob("*"):
            if there.is_file():
                self.assertEqual(
                    (back / there.relative_to(self.folder / "cycle")).read_bytes(), there.read_bytes(), there
                )
        tables = []
        for log, out in [(self.folder / "force", self.folder / "p1"), (self.folder / "force.mcap", self.folder / "p2")]:
            self.result("locate", log, "--out", out)
            tables.append({p.name: p.read_bytes() for p in out.iterdir()})
        self.assertEqual(*tables)

    def test_a_cut_mcap_file_is_read_up_to_the_cut(self):
        file, cut = self.folder / "to_cut.mcap", self.folder / "was_cut.mcap"
        self.result("convert", self.folder / "force", file)
        cut.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        shutil.copy(self.folder / "to_cut.truth.csv", self.folder / "was_cut.truth.csv")
        whole, half = self.result("locate", file), self.result("locate", cut)
        self.assertGreater(half["samples"], 0)
        self.assertLess(half["samples"], whole["samples"])
        self.assertIn("was_cut.mcap: byte ", run("locate", cut).stderr)

    def test_a_log_of_ones_own_is_told_what_was_found(self):
        own = self.folder / "own"
        shutil.copytree(self.folder / "force", own)
        os.remove(own / "truth.csv")
        session = json.loads((own / "session.json").read_text())
        session["segments"] = [s for s in session["segments"] if s["kind"] == "unloaded"]
        (own / "session.json").write_text(json.dumps(session))
        for command, words in [("locate", "touched in "), ("force", "with a force in ")]:
            known, blind = (self.result(command, log) for log in (self.folder / "force", own))
            self.assertEqual(blind["samples"], 0)
            self.assertEqual(blind["contacts"], known["contacts"])  # whether or not there is a truth
            self.assertEqual(blind["log"], known["log"])
            rows = rows_of(self.folder / "force" / "frames.csv")
            self.assertEqual((blind["frames"]["rows"], blind["log"]["pictures"]["read"]), (len(rows), len(rows)))
            longest = sorted(c["frames"] for c in blind["contacts"])[-6:]
            self.assertGreater(sum(longest), 400)
            self.assertLessEqual(sum(c["frames"] for c in blind["contacts"]), blind["frames"]["touched"])
            text = run(command, own, "--quiet").stdout
            self.assertTrue(text.startswith(f"{len(rows)} frames: touched in "), text)
            self.assertIn(words, text)
            self.assertIn("no errors: the log has no truth.csv", text)
            self.assertNotIn("0 frames in contact", text)

    def test_each_mean_has_its_own_count(self):
        r = self.result("force", self.folder / "force", "--out", self.folder / "counted")
        truth = {row["stamp_ns"]: row for row in rows_of(self.folder / "force" / "truth.csv")}
        rows = [
            row
            for row in rows_of(self.folder / "counted" / "forces.csv")
            if float(truth[row["stamp_ns"]]["force_N"]) >= 0.5
        ]
        errors = [
            abs(float(row["force_N"]) - float(truth[row["stamp_ns"]]["force_N"])) for row in rows if row["force_N"]
        ]
        self.assertEqual(r["frames"]["in_contact"], len(rows))
        self.assertEqual(sum(r["frames"]["without_force"].values()), len(rows) - len(errors))
        self.assertLessEqual(r["samples_of"]["fused"], len(errors))  # joints must be known, too
        self.assertGreaterEqual(r["samples_of"]["fused"], 0.99 * len(errors))
        text = run("force", self.folder / "force", "--quiet").stdout
        self.assertIn(f"  fused           {r['mae_N']['fused']:.2f}, of {r['samples_of']['fused']} frames", text)
        self.assertIn(f"{len(rows)} frames in contact", text)
        located = self.result("locate", self.folder / "force")
        text = run("locate", self.folder / "force", "--quiet").stdout
        self.assertIn(f"{located['mae_mm']:.2f} mm of the {located['located']} located", text)

    def test_what_is_missing_is_told(self):
        lossy = self.folder / "lossy"
        shutil.copytree(self.folder / "force", lossy)
        frames = sorted((lossy / "frames").iterdir())
        for frame in frames[600:640]:
            frame.unlink()
        for frame in frames[700:720]:
            frame.write_bytes(b"no picture")
        lines = (lossy / "joint.csv").read_text().splitlines(keepends=True)
        half = len(lines) // 2
        (lossy / "joint.csv").write_text("".join(lines[:half] + [lines[half - 1]]))  # ends halfway, a row twice
        done = run("force", lossy, "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        r = json.loads(done.stdout)
        pictures = r["log"]["pictures"]
        self.assertEqual((pictures["missing"], pictures["damaged"]), (40, 20))
        self.assertEqual(r["log"]["streams"]["joint_states"]["left_out_repeated"], 1)
        self.assertGreater(r["log"]["streams"]["joint_states"]["pictures_outside"], 300)
        self.assertGreater(r["frames"]["in_contact"], r["samples"])
        self.assertIn("40 missing, 20 damaged", done.stderr)
        self.assertIn("1 came twice", done.stderr)
        self.assertIn("outside of the joint states' time", done.stderr)
        (lossy / "joint.csv").write_text("no table\n")
        done = run("locate", lossy)  # which needs none
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("joint states are not used", done.stderr)
        self.refused(BAD_FILE, ["joint.csv:1:"], "force", lossy, "--quiet")
        header, *rows = lines
        stuck = [",".join([*row.split(",")[:3], "0.5\n"]) for row in rows]
        (lossy / "joint.csv").write_text("".join([header, *stuck]))
        self.refused(BAD_FILE, ["effort of joint 0 never changes", "0.5 A"], "force", lossy, "--quiet")
        shifted = [str(int(row.split(",")[0]) + 10**15) + row[row.index(",") :] for row in rows]
        (lossy / "joint.csv").write_text("".join([header, *shifted]))
        self.refused(BAD_FILE, ["no time in common", "joint_clock"], "force", lossy, "--quiet")

    def test_a_spreadsheets_table_is_the_same(self):
        saved = self.folder / "saved"
        shutil.copytree(self.folder / "force", saved)
        text = (saved / "joint.csv").read_text().replace(",", ";").replace(".", ",").replace("\n", "\r\n")
        (saved / "joint.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())
        results = [self.result("force", log) for log in (self.folder / "force", saved)]
        for r in results:
            r.pop("frame_ms")
        self.assertEqual(*results)

    def test_without_truth_what_needs_it_is_null(self):
        bare = self.folder / "bare"
        shutil.copytree(self.folder / "force", bare)
        os.remove(bare / "truth.csv")
        os.remove(bare / "wrench.csv")
        session = json.loads((bare / "session.json").read_text())
        session["segments"] = [s for s in session["segments"] if s["kind"] == "unloaded"]
        (bare / "session.json").write_text(json.dumps(session))
        r = self.result("locate", bare)
        self.assertEqual((r["samples"], r["mae_mm"], r["coverage_90"]), (0, None, None))
        r = self.result("force", bare)
        self.assertEqual(r["samples"], 0)
        self.assertTrue(all(v is None for v in r["mae_N"].values()))
        self.assertGreater(r["frame_ms"]["median"], 0.0)

    def test_estimates_do_not_depend_on_the_truth(self):
        lied = self.folder / "lied"
        shutil.copytree(self.folder / "force", lied)
        os.remove(lied / "truth.csv")
        os.remove(lied / "wrench.csv")
        tables = []
        for log, out in [(self.folder / "force", self.folder / "o1"), (lied, self.folder / "o2")]:
            self.result("force", log, "--out", out)
            tables.append(
                [[row[k] for k in ["stamp_ns", "force_N", "y_mm", "state"]] for row in rows_of(out / "forces.csv")]
            )
        self.assertEqual(*tables)

    def derived(self, kind, name, table="joint.csv", column=None, by=None, session=None):
        """A log whose table has one column multiplied, and whose session has other keys."""
        log = self.folder / name
        shutil.copytree(self.folder / kind, log, ignore=shutil.ignore_patterns("*.json" if session else "?"))
        if column:
            rows = rows_of(log / table)
            with open(log / table, "w", newline="") as file:
                out = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
                out.writeheader()
                for row in rows:
                    out.writerow({**row, column: repr(by * float(row[column]))})
        if session:
            known = json.loads((self.folder / kind / "session.json").read_text())
            (log / "session.json").write_text(json.dumps({**known, **session}))
        return log

    def noted(self, words, *arguments):
        done = run(*arguments)
        self.assertEqual(done.returncode, 0, done.stderr)
        for word in words:
            self.assertIn(word, done.stderr)
        return done

    def test_streams_are_checked_against_each_other(self):
        for kind in ["force", "recontact"]:
            for command in ["locate", "force", "metrics"] if kind == "recontact" else ["locate", "force"]:
                done = run(command, self.folder / kind)
                self.assertNotIn(str(self.folder / kind) + ":", done.stderr)  # nothing speaks against a clean log

        self.noted(
            ["joint 0 falls", "constant of -0."],
            "force",
            self.derived("force", "reversed", column="current_A_0", by=-1.0),
        )
        self.noted(
            ["velocities of joint 0", "taken from the positions"],
            "force",
            self.derived("force", "still", column="velocity_rad_per_s_0", by=0.0),
        )
        self.noted(
            ["negative in the holds"],
            "force",
            self.derived("force", "turned", table="wrench.csv", column="force_z_N", by=-1.0),
        )
        self.refused(
            BAD_FILE,
            ["effort of joint 0 never changes"],
            "force",
            self.derived("force", "silent", column="current_A_0", by=0.0),
            "--quiet",
        )

    def test_slopes_are_per_newton_that_pressed(self):
        log = self.derived("recontact", "short", table="wrench.csv", column="force_z_N", by=0.8)
        self.noted(["80 % of each load"], "metrics", log)
        whole, short = (self.result("metrics", path) for path in [self.folder / "recontact", log])
        self.assertAlmostEqual(short["D_neighbor"] * 0.8, whole["D_neighbor"], delta=1e-6 * whole["D_neighbor"])
        self.assertAlmostEqual(short["W_recontact"] * 0.8, whole["W_recontact"], delta=1e-6 * whole["W_recontact"])

    def test_when_the_finger_was_unloaded(self):
        log = self.derived("force", "no-segments", session={"segments": []})
        self.noted(["may have been touched"], "locate", log, "--unloaded", "14.7,15.2")
        done = run("locate", log, "--unloaded", "9.6,10.4")
        self.assertNotIn("touched", done.stderr)
        self.refused(USAGE, ["--unloaded is '3'", "two times"], "locate", log, "--unloaded", "3")
        self.refused(USAGE, ["--unloaded is '4,3'", "end after"], "force", log, "--unloaded", "4,3")
        leds = json.loads((self.folder / "force" / "session.json").read_text())["leds"]
        upright = self.derived("force", "upright", session={"leds": {**leds, "distal": [0, 1]}})
        self.refused(BAD_FILE, ["which end is the tip", "[1, 0]"], "locate", upright, "--quiet")

    def test_refusals(self):
        self.refused(USAGE, ["--out is missing"], "lab", "force")
        self.refused(USAGE, ["--noise"], "lab", "force", "--out", self.folder / "x", "--noise", "-1")
        self.refused(USAGE, ["unknown command", "'everything'"], "lab", "everything")
        self.refused(INFEASIBLE, [], "lab", "force", "--out", self.folder / "x", "--theta", "1,1,1,1,1")
        self.refused(
            BAD_FILE,
            ["not empty"],
            "lab",
            "force",
            *PLAIN,
            "--coarse",
            "--out",
            self.folder / "force",
            "--cache",
            self.folder / "cache",
        )
        for command in ["decode", "metrics", "locate", "force", "hand"]:
            self.refused(USAGE, ["log is missing"], command)
            self.refused(BAD_FILE, ["session.json"], command, self.folder / "nothing", "--quiet")
        self.refused(USAGE, ["--decoder"], "decode", self.folder / "force", "--decoder", "best")
        dark = self.folder / "dark"
        shutil.copytree(self.folder / "force", dark)
        for frame in (dark / "frames").iterdir():
            frame.write_bytes(b"no picture")
        self.refused(BAD_FILE, ["dark", "unloaded finger"], "locate", dark, "--quiet")
        if not os.path.exists("/dev/video63"):
            self.refused(BAD_FILE, ["/dev/video63", "no such camera"], "doctor", "--camera", "63")
            self.refused(
                BAD_FILE, ["/dev/video63", "no such camera"], "locate", "--camera", "63", "--seconds", "5", "--quiet"
            )
            self.refused(
                BAD_FILE,
                ["/dev/video63", "no such camera"],
                "locate",
                self.folder / "force",
                "--camera",
                "63",
                "--quiet",
            )
            for command in ["decode", "metrics", "record"]:  # no folder is made before the camera is there
                self.refused(
                    BAD_FILE,
                    ["/dev/video63", "no such camera"],
                    command,
                    self.folder / "recontact",
                    "--camera",
                    "63",
                    "--out",
                    self.folder / "live",
                    "--quiet",
                )
            self.assertFalse((self.folder / "live").exists())
            for command, motors in [("force", "1"), ("hand", "1,2,3,4")]:
                self.refused(
                    BAD_FILE,
                    ["/dev/video63", "no such camera"],
                    command,
                    self.folder / command,
                    "--camera",
                    "63",
                    "--can",
                    "nocan0",
                    "--motors",
                    motors,
                    "--quiet",
                )
            bare = self.folder / "unplanned"
            bare.mkdir()
            (bare / "session.json").write_text('{"format": "lumo-log", "version": 1}')
            self.refused(
                BAD_FILE, ["no segments"], "decode", bare, "--camera", "63", "--out", self.folder / "live", "--quiet"
            )
        self.refused(
            USAGE,
            ["--motors", "1 motor", "4 joints"],
            "hand",
            self.folder / "hand",
            "--camera",
            "63",
            "--can",
            "nocan0",
            "--quiet",
        )
        self.refused(
            USAGE,
            ["--motors", "2 motors", "1 joint"],
            "force",
            self.folder / "force",
            "--camera",
            "63",
            "--can",
            "nocan0",
            "--motors",
            "1,2",
            "--quiet",
        )
        self.refused(USAGE, ["--exposure", "--rate"], "locate", "--camera", "63", "--exposure", "100")
        self.refused(USAGE, ["--rate is '1'"], "locate", "--camera", "63", "--rate", "1")
        log = self.folder / "force"
        self.refused(USAGE, ["--seconds", "--camera"], "locate", log, "--seconds", "5")
        self.refused(USAGE, ["--motors", "--can"], "force", log, "--camera", "63", "--motors", "2")
        self.refused(USAGE, ["--motors is '1,1'"], "force", log, "--camera", "63", "--can", "nocan0", "--motors", "1,1")
        self.refused(
            USAGE,
            ["--motor-ranges is '3'", "three numbers"],
            "force",
            log,
            "--camera",
            "63",
            "--can",
            "nocan0",
            "--motor-ranges",
            "3",
        )
        self.refused(USAGE, ["--can is missing"], "force", log, "--camera", "63")
        self.refused(USAGE, ["--pixels is '640'", "640x480"], "locate", "--camera", "63", "--pixels", "640")
        self.refused(USAGE, ["--exposure is '0'", "ms"], "doctor", "--camera", "63", "--exposure", "0")
        self.refused(
            USAGE,
            ["--out", "lumo record"],
            "force",
            log,
            "--camera",
            "63",
            "--can",
            "nocan0",
            "--out",
            self.folder / "live",
        )
        self.refused(USAGE, ["--out is missing"], "metrics", log, "--camera", "63")
        self.refused(USAGE, ["log is missing"], "hand", "--camera", "63", "--can", "nocan0")
        self.refused(USAGE, ["--camera is missing"], "record", log, "--out", self.folder / "live")
        self.refused(USAGE, ["--out is missing"], "record", log, "--camera", "63")
        self.refused(USAGE, ["--from", "live"], "locate", "--camera", "63", "--from", "3")


if __name__ == "__main__":
    LUMO = os.path.abspath(sys.argv.pop(1))
    unittest.main()
