"""Stores of campaigns from outside: what is read of intact ones, of another version's, of damaged ones.

usage: test_store.py path/to/lumo path/to/make_store
"""

import csv
import io
import json
import pathlib
import re
import sqlite3
import subprocess
import sys
import tempfile
import time
import unittest

LUMO = MAKE_STORE = ""
BAD_FILE = 5


def run(*arguments):
    return subprocess.run(
        [LUMO, *map(str, arguments)], capture_output=True, encoding="utf-8", errors="replace", timeout=600
    )  # a failure of made-up stores holds a byte that is no UTF-8


class Stores(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.store = pathlib.Path(self.folder.name) / "s.db"

    def make(self, what, *version, store=None, silicone="DS", ensemble="flat"):
        subprocess.run([MAKE_STORE, store or self.store, silicone, ensemble, what, *version], check=True, timeout=300)

    def read(self, command, *arguments):
        done = run("campaign", command, "--store", self.store, *arguments)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return done.stdout

    def flip(self, text, at):
        """Flips the lowest bit of one byte of a text, wherever the file holds it: a page that was split leaves
        copies."""
        data, wanted = self.store.read_bytes(), text.encode()
        self.assertIn(wanted, data)
        self.store.write_bytes(data.replace(wanted, wanted[:at] + bytes([wanted[at] ^ 1]) + wanted[at + 1 :]))

    def contents(self, number):
        with sqlite3.connect(self.store) as db:
            return db.execute("SELECT kind, content FROM entry WHERE number = ?", (number,)).fetchone()

    def test_export(self):
        self.make("12")
        trials = json.loads(self.read("export", "--json"))
        table = list(csv.reader(io.StringIO(self.read("export"))))
        self.assertEqual(
            table[0],
            "index,h_fp_mm,h_ep_mm,w_s_mm,h_s_mm,w_v_mm,state,J_contact,J_contact_err,J_obs,J_obs_err,hypervolume,on_front,selected,worst_contact_diameter_mm,"
            "worst_contact_angle_deg,worst_contact_y_mm,worst_observation_diameter_mm,worst_observation_angle_deg,worst_observation_load_N,worst_observation_y_a_mm,"
            "worst_observation_y_b_mm,nodes,elements,seconds,why".split(","),
        )
        self.assertEqual(len(table) - 1, len(trials))
        self.assertEqual(sum(t["state"] == "evaluated" for t in trials), 12)
        self.assertEqual(sum(t["state"] == "failed" for t in trials), 1)
        for line, t in zip(table[1:], trials):
            row, record = dict(zip(table[0], line, strict=True)), t["record"]
            self.assertEqual(
                [int(row["index"]), row["state"], row["on_front"], row["selected"]],
                [t["index"], t["state"], str(int(t["on_front"])), str(int(t["selected"]))],
            )
            self.assertEqual([float(v) for v in line[1:6]], t["theta_mm"])
            self.assertEqual(float(row["seconds"]), t["notes"]["seconds"]["total"])
            if t["state"] == "failed":
                self.assertEqual([row[k] for k in ("J_contact", "J_obs", "hypervolume", "nodes")], [""] * 4)
                self.assertIn('"quotes"', row["why"])
                continue
            self.assertEqual(row["why"], "")
            worst = record["worst_contact"], record["worst_observation"]
            expected = [
                record["J_contact"],
                record["J_contact_err"],
                record["J_obs"],
                record["J_obs_err"],
                t["hypervolume"],
                worst[0]["diameter_mm"],
                worst[0]["angle_deg"],
                worst[0]["y_mm"],
                worst[1]["diameter_mm"],
                worst[1]["angle_deg"],
                worst[1]["load_N"],
                *worst[1]["y_mm"],
                record["mesh"]["nodes"],
                record["mesh"]["elements"],
            ]
            self.assertEqual([float(v) for v in line[7:12] + line[14:24]], expected)

    def test_verify_names_the_entry(self):
        self.make("4")
        self.assertIn("ok", self.read("verify"))
        good = self.store.read_bytes()
        for number in (1, 5, 8):
            self.store.write_bytes(good)
            kind, content = self.contents(number)
            self.flip(kind + content, len(kind) + 2)
            done = run("campaign", "verify", "--store", self.store)
            self.assertEqual((done.returncode, done.stdout, done.stderr.count("\n")), (BAD_FILE, "", 1), done.stderr)
            self.assertRegex(done.stderr, rf"damaged at entry {number}\b")

    def test_verify_names_the_entry_from_which_a_cut_file_lacks_them(self):
        self.make("12")
        good = self.store.read_bytes()
        last = 0
        for kept in [*range(1, 10), *range(10, len(good) // 4096, 9), len(good) // 4096 - 1]:
            self.store.write_bytes(good[: 4096 * kept + 100])
            for command in ("verify", "status"):
                done = run("campaign", command, "--store", self.store)
                self.assertEqual(
                    (done.returncode, done.stdout, done.stderr.count("\n")), (BAD_FILE, "", 1), done.stderr
                )
            named = re.search(r"is damaged (?:at|after) entry (\d+)", done.stderr)
            self.assertTrue(named or kept < 5, done.stderr)  # the first pages are SQLite's own
            number = int(named[1]) if named else 0
            self.assertGreaterEqual(number, last)
            last = number
        self.assertEqual(last, 26)  # the last page holds a part of the last entry

    def test_damaged_notes_are_null(self):
        self.make("2")
        with sqlite3.connect(self.store) as db:
            db.execute('UPDATE entry SET notes = \'{"lumo": "0.1.0", "threads\' WHERE number = 2')
        self.assertIn("ok", self.read("verify"))
        trials = json.loads(self.read("export", "--json"))
        self.assertIsNone(trials[0]["notes"])
        self.assertIsNotNone(trials[0]["record"])
        self.assertEqual(trials[1]["notes"]["threads"], 2)
        self.read("status")
        self.read("export")

    def test_another_version_is_read(self):
        self.make("9")
        mine = self.read("status")
        self.assertNotIn("version", mine)
        status = json.loads(self.read("status", "--json"))
        now = status["results_version"]
        self.assertEqual(status["results_version_of_lumo"], now)
        self.store.unlink()
        self.make("9", str(now - 1))
        other = self.read("status")
        self.assertIn(f"results are of version {now - 1}, this lumo computes version {now}", other)
        # But for that line and the digest all is read as before.
        self.assertEqual([l for l in other.splitlines() if "version" not in l], mine.splitlines())
        self.assertEqual(json.loads(self.read("status", "--json"))["results_version"], now - 1)
        self.assertIn("ok", self.read("verify"))
        self.assertEqual(len(json.loads(self.read("export", "--json"))), 10)

    def test_another_search_of_another_version_is_refused(self):
        self.make("1", '1,\n "another_key": 1')
        self.read("status")
        self.store.unlink()
        self.make("1", '1,\n "variable extra": 1')
        done = run("campaign", "status", "--store", self.store)
        self.assertEqual((done.returncode, done.stdout), (BAD_FILE, ""))
        self.assertIn("belongs to another problem", done.stderr)

    def test_errors_are_taken_into_account_and_said(self):
        self.make("14", "errors")
        status = json.loads(self.read("status", "--json"))
        self.assertEqual(status["noise"], "estimated")
        self.assertEqual(status["values"], "means of the models, as there is noise: J_contact, J_obs")
        low, high = status["interval_90"]
        self.assertLessEqual(low, status["hypervolume"])
        self.assertLessEqual(status["hypervolume"], high)
        self.assertLess(low, high)
        text = self.read("status")
        self.assertRegex(text, r"hypervolume \S+ \(90 %: \S+ to \S+\), values means of the models")
        self.assertIn("front (means of the models", text)
        self.assertIn("±", text)
        trials = [t for t in json.loads(self.read("export", "--json")) if t["state"] == "evaluated"]
        for key in ("J_contact", "J_obs"):
            computed = [t["record"][key] for t in trials]
            for t in trials:
                # Made without noise: what is believed is what was computed, within the half width that it was given,
                # and known to a part of what designs differ by.
                self.assertLess(abs(t[key + "_mean"] - t["record"][key]), t["record"][key + "_err"])
                self.assertLess(t[key + "_mean_err"], 0.1 * (max(computed) - min(computed)))
        self.assertEqual(trials[-1]["hypervolume"], status["hypervolume"])
        table = list(csv.DictReader(io.StringIO(self.read("export"))))
        row = next(r for r in table if r["state"] == "evaluated")
        self.assertEqual(float(row["J_obs_mean"]), trials[0]["J_obs_mean"])
        done = run("campaign", "select", "--store", self.store, "--seeds", 1, "--json", "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        chosen = json.loads(done.stdout)
        self.assertEqual(chosen["values"], status["values"])
        best = {key: max(t[key + "_mean"] for t in trials) for key in ("J_contact", "J_obs")}
        expected = max(trials, key=lambda t: min(t[key + "_mean"] / best[key] for key in best))
        self.assertEqual(chosen["index"], expected["index"])

    def test_a_store_without_errors_stays_as_it_was(self):
        self.make("9", "exact", ensemble="flat-built")
        _, problem = self.contents(0)
        self.assertNotIn("noise", problem)
        status = json.loads(self.read("status", "--json"))
        self.assertEqual((status["noise"], status["values"], status["interval_90"]), ("none", "as reported", None))
        digest = status["digest"]
        done = run("campaign", "run", "--store", self.store, "--evaluations", 9, "--json", "--threads", 1)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("it goes on so (search.noise is none)", done.stderr)
        self.assertEqual(json.loads(done.stdout)["digest"], digest)
        done = run("campaign", "run", "--store", self.store, "--set", "search.noise=present", "--evaluations", 9)
        self.assertEqual((done.returncode, done.stdout), (BAD_FILE, ""))
        self.assertIn("belongs to another problem", done.stderr)

    def start(self, store, *arguments):
        """Begins a search and ends it once its store is there."""
        begun = subprocess.Popen(
            [LUMO, "campaign", "run", "--store", store, "--threads", "1", *map(str, arguments)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        until = time.monotonic() + 120
        while begun.poll() is None and time.monotonic() < until:
            if run("campaign", "status", "--store", store).returncode == 0:
                break
            time.sleep(0.1)
        begun.terminate()
        return begun.communicate(timeout=60)[1], begun.returncode

    def test_known_results_stay_with_their_store(self):
        folder = pathlib.Path(self.folder.name)
        earlier, old = folder / "earlier.db", folder / "old.db"
        self.make("5", "errors", store=earlier, ensemble="flat-built")
        table = folder / "known.csv"
        table.write_text(run("campaign", "export", "--store", earlier).stdout)
        now = json.loads(run("campaign", "status", "--store", earlier, "--json").stdout)["results_version"]
        self.make("4", str(now - 1), store=old, ensemble="flat-built")
        for known, count, on_front in ((earlier, 5, True), (table, 5, True), (old, 4, False)):
            with self.subTest(known=known.name):
                store = folder / f"of-{known.name}.db"
                said, code = self.start(store, "--known", known)
                self.assertEqual(code, 130, said)
                status = json.loads(run("campaign", "status", "--store", store, "--json").stdout)
                self.assertEqual((status["known"], status["evaluated"]), (count, 0))
                self.assertEqual(bool(status["known_on_front"]), on_front)
                text = run("campaign", "status", "--store", store).stdout
                self.assertIn(f"knows {count} earlier results", text)
                self.assertEqual("which are in no front" in text, not on_front)
                self.assertIn("ok", run("campaign", "verify", "--store", store).stdout)
                copy = folder / f"copy-of-{known.name}.db"
                self.assertEqual(run("campaign", "copy", store, copy).returncode, 0)
                again = json.loads(run("campaign", "status", "--store", copy, "--json").stdout)
                self.assertEqual((again["known"], again["digest"]), (count, status["digest"]))
                # What is known is no proposal, and a later run need not name it.
                with sqlite3.connect(store) as db:
                    asked = [r[0] for r in db.execute("SELECT content FROM entry WHERE kind = 'ask'")]
                    problem = json.loads(db.execute("SELECT content FROM entry WHERE number = 0").fetchone()[0])
                designs = [problem[f"known {k}"]["theta_mm"] for k in range(count)]
                for content in asked:
                    self.assertNotIn([float(v) for v in content.split()[1:]], designs)
                self.assertEqual(problem["known 0"].get("results"), {earlier: now, old: now - 1}.get(known))
                said, code = self.start(store)
                self.assertEqual(code, 130, said)
        self.make("6", "errors", store=folder / "more.db", ensemble="flat-built")
        done = run("campaign", "run", "--store", store, "--known", folder / "more.db")
        self.assertEqual((done.returncode, done.stdout, done.stderr.count("\n")), (BAD_FILE, "", 1))
        self.assertIn("was begun with 4 known results, which stay as they are: --known gives 6", done.stderr)

    def test_known_results_of_other_objectives_are_refused(self):
        other, table = (pathlib.Path(self.folder.name) / name for name in ("sol.db", "of_another.csv"))
        table.write_text("a,b\n1,2\n")
        self.make("2", store=other, silicone="Sol")
        for arguments, said in (
            (("--finger", "plain", "--known", other), "is of other objectives: silicone.name is"),
            (("--known", other), "is of other objectives"),
            (("--known", "nowhere.csv"), "'nowhere.csv' cannot be opened"),
            (("--known", table), "column 'h_fp' is missing"),
        ):
            done = run("campaign", "run", "--store", self.store, *arguments)
            self.assertEqual((done.returncode, done.stdout, done.stderr.count("\n")), (BAD_FILE, "", 1), done.stderr)
            self.assertIn(said, done.stderr)
            self.assertFalse(self.store.exists())

    def test_an_emptied_store_is_reported(self):
        for command in (["campaign", "run"], ["study", "carrier"]):
            self.store.write_bytes(b"")
            begun = subprocess.Popen(
                [LUMO, *command, "--store", self.store, "--threads", "1"],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
            warning = begun.stderr.readline()
            begun.terminate()
            begun.communicate(timeout=60)
            self.assertIn("is empty (0 bytes)", warning)


if __name__ == "__main__":
    LUMO, MAKE_STORE = (str(pathlib.Path(p).resolve()) for p in (sys.argv.pop(1), sys.argv.pop(1)))
    unittest.main()
