"""The README's commands: each one that the program has is in its table, and each one that it shows starts.

usage: test_readme.py path/to/lumo path/to/make_store
"""
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import unittest

README = (pathlib.Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")
LUMO = MAKE_STORE = ""
STARTED_S = 3.0   # what is wrong about a command line is told at once
ANSWERS = "".join('{"tell": {"id": %d, "y": [%d]}}\n' % (k, k) for k in range(4))   # for `optimize`


def subcommands(*words):
    helped = subprocess.run([LUMO, *words, "--help"], capture_output=True, text=True, check=True).stdout
    return re.findall(r"^  (\w+) {2,}", helped.partition("Subcommands:")[2], re.MULTILINE)


class Readme(unittest.TestCase):
    def test_every_command_is_in_the_table(self):
        rows = [re.findall(r"`([^`]+)`", row) for row in re.findall(r"^\| (`.*)", README, re.MULTILINE)]
        self.assertGreater(len(rows), 10)
        commands = subcommands()
        self.assertGreater(len(commands), 10)
        for command in commands:
            for last in subcommands(command) or [""]:
                wanted = f"{command} {last}".strip()
                self.assertTrue(any(wanted in row or (row[0].startswith(command + " ") and last in row) for row in rows), wanted)

    def test_every_command_shown_starts(self):
        shown = [re.split(r" [#>]", line)[0].split()[1:] for block in re.findall(r"```sh\n(.*?)```", README, re.DOTALL) for line in block.splitlines()
                 if line.startswith("build/release/lumo ")]
        self.assertGreater(len(shown), 10)
        with tempfile.TemporaryDirectory() as folder:
            # What is to be read must be there: a search of the README's name, and the space that its text describes.
            subprocess.run([MAKE_STORE, os.path.join(folder, "ds_flat.db"), "DS", "flat", "3"], check=True)
            (pathlib.Path(folder) / "space.json").write_text('{"variables": [{"name": "a", "lower": 2, "upper": 29, "step": 0.5}], "objectives": [{"name": "f", "goal": "maximize", "reference": 0}], '
                                                             '"evaluations": 4}')
            for words in shown:
                with self.subTest(words):
                    process = subprocess.Popen([LUMO, *words], cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
                    try:
                        _, complaint = process.communicate(ANSWERS, timeout=STARTED_S)
                    except subprocess.TimeoutExpired:
                        process.send_signal(signal.SIGTERM)
                        _, complaint = process.communicate(timeout=60)
                        self.assertIn(process.returncode, (0, 130), complaint)
                        continue
                    self.assertEqual(process.returncode, 0, complaint)


if __name__ == "__main__":
    LUMO, MAKE_STORE = (os.path.abspath(path) for path in (sys.argv.pop(1), sys.argv.pop(1)))
    unittest.main()
