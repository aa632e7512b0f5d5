"""The commands of the README and of the manual: each one that the program has is in the table, each one shown starts.

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

ROOT = pathlib.Path(__file__).resolve().parents[2]
SHOWN = "\n".join((ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/manual.md"))
LUMO = MAKE_STORE = ""
STARTED_S = 3.0  # a wrong command line is reported at once
MADE_S = 900.0  # for what later commands read: the logs of the virtual lab
ANSWERS = "".join('{"tell": {"id": %d, "y": [%d]}}\n' % (k, k) for k in range(4))  # for `optimize`
SPACE = (
    '{"variables": [{"name": "a", "lower": 2, "upper": 29, "step": 0.5}], '
    '"objectives": [{"name": "f", "goal": "maximize", "reference": 0}], "evaluations": 4}'
)


def subcommands(*words):
    helped = subprocess.run([LUMO, *words, "--help"], capture_output=True, text=True, check=True).stdout
    return re.findall(r"^  (\w+) {2,}", helped.partition("Subcommands:")[2], re.MULTILINE)


def shown_commands():
    lines = [line for block in re.findall(r"```sh\n(.*?)```", SHOWN, re.DOTALL) for line in block.splitlines()]
    return [re.split(r" [#>]", line)[0].split()[1:] for line in lines if line.startswith("build/release/lumo ")]


class Readme(unittest.TestCase):
    def test_every_command_is_in_the_table(self):
        rows = [re.findall(r"`([^`]+)`", row) for row in re.findall(r"^\| (`\w.*)", SHOWN, re.MULTILINE)]
        self.assertGreater(len(rows), 10)
        commands = subcommands()
        self.assertGreater(len(commands), 10)
        for command in commands:
            for last in subcommands(command) or [""]:
                wanted = f"{command} {last}".strip()
                named = any(wanted in row or (row[0].startswith(command + " ") and last in row) for row in rows)
                self.assertTrue(named, wanted)

    def test_every_command_shown_starts(self):
        commands = shown_commands()
        self.assertGreater(len(commands), 18)
        with tempfile.TemporaryDirectory() as folder:
            # What is to be read must be there: a search of the manual's name, and the space that its text describes.
            subprocess.run([MAKE_STORE, os.path.join(folder, "ds_flat.db"), "DS", "flat-built", "3"], check=True)
            (pathlib.Path(folder) / "space.json").write_text(SPACE)
            for words in commands:
                with self.subTest(words):
                    self.starts(words, folder)

    def starts(self, words, folder):
        process = subprocess.Popen(
            [LUMO, *words], cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        try:
            _, complaint = process.communicate(ANSWERS, timeout=MADE_S if words[0] == "lab" else STARTED_S)
            self.assertEqual(process.returncode, 0, complaint)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGTERM)
            _, complaint = process.communicate(timeout=60)
            self.assertIn(process.returncode, (0, 130), complaint)


if __name__ == "__main__":
    LUMO, MAKE_STORE = (os.path.abspath(path) for path in (sys.argv.pop(1), sys.argv.pop(1)))
    unittest.main()
