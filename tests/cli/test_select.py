"""`lumo campaign select` from outside.

usage: test_select.py path/to/lumo path/to/make_store
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

LUMO = MAKE_STORE = ""


def run(*arguments):
    return subprocess.run([LUMO, *map(str, arguments)], capture_output=True, text=True, timeout=900)


class Select(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.store = pathlib.Path(self.folder.name) / "s.db"

    def tearDown(self):
        self.folder.cleanup()

    def make(self, what, *version):
        subprocess.run([MAKE_STORE, self.store, "DS", "flat", what, *version], check=True, timeout=300)

    def test_the_balanced_choice(self):
        self.make("12")
        done = run("campaign", "select", "--store", self.store, "--seeds", 3, "--json", "--quiet")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        chosen = json.loads(done.stdout)
        trials = [
            t
            for t in json.loads(run("campaign", "export", "--json", "--store", self.store).stdout)
            if t["state"] == "evaluated"
        ]
        best = {key: max(t["record"][key] for t in trials) for key in ("J_contact", "J_obs")}
        expected = max(trials, key=lambda t: min(t["record"][key] / best[key] for key in best))
        self.assertEqual((chosen["index"], chosen["theta_mm"]), (expected["index"], expected["theta_mm"]))
        for share, key in zip(chosen["share_of_best"], best):
            self.assertAlmostEqual(share, expected["record"][key] / best[key], places=12)
        stability = chosen["stability"]
        self.assertEqual(stability["searches"], 3)
        self.assertEqual(sum(c["count"] for c in stability["choices"]), 3)
        self.assertEqual(
            stability["same"], sum(c["count"] for c in stability["choices"] if c["theta_mm"] == chosen["theta_mm"])
        )
        self.assertEqual(chosen["gain_angles_deg"], [-30, 0, 30])
        self.assertEqual(chosen["gain_percent"][0], chosen["gain_percent"][2])  # the pad is its own mirror image
        self.assertEqual(len(chosen["table_2"]), 4)

    def test_the_baseline_gains_nothing_on_itself(self):
        self.make("6,6,8,5,0", "1")  # results of another version are read, too
        done = run("campaign", "select", "--store", self.store, "--json", "--quiet")
        chosen = json.loads(done.stdout)
        self.assertEqual(chosen["gain_percent"], [0, 0, 0])
        self.assertIsNone(chosen["stability"])  # one result is no model

    def test_nothing_to_choose_from(self):
        self.make("0")
        done = run("campaign", "select", "--store", self.store)
        self.assertEqual((done.returncode, done.stdout), (5, ""))
        self.assertIn("nothing to select from", done.stderr)


if __name__ == "__main__":
    LUMO, MAKE_STORE = sys.argv.pop(1), sys.argv.pop(1)
    unittest.main()
