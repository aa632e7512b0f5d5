"""The page about `lumo optimize`: each piece of it runs, and prints what the page says.

usage: test_optimize_page.py path/to/lumo
"""

import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

PAGE = pathlib.Path(__file__).resolve().parents[2] / "docs" / "pages" / "optimize.md"
LUMO = ""


class Page(unittest.TestCase):
    def test_every_piece_prints_what_the_page_says(self):
        blocks = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
        printed, ran = None, 0
        with tempfile.TemporaryDirectory() as folder:
            place = pathlib.Path(folder)
            (place / "bin").mkdir()
            (place / "bin" / "lumo").symlink_to(LUMO)
            environment = {**os.environ, "PATH": f"{place / 'bin'}{os.pathsep}{os.environ['PATH']}"}
            for kind, text in blocks:
                if kind == "text":
                    self.assertEqual(printed, text)
                    printed, ran = None, ran + 1
                    continue
                name = re.match(r"# (\w+\.py)\n", text)[1] if kind == "python" else "space.json"
                self.assertIsNone(printed, name)  # each output is compared
                (place / name).write_text(text, encoding="utf-8")
                if kind == "python" and name != "asking.py":
                    done = subprocess.run(
                        [sys.executable, name], cwd=place, env=environment, capture_output=True, text=True, timeout=600
                    )
                    self.assertEqual((done.returncode, done.stderr), (0, ""), name)
                    printed = done.stdout
        self.assertIsNone(printed)
        self.assertEqual(ran, 6)


if __name__ == "__main__":
    LUMO = str(pathlib.Path(sys.argv.pop(1)).resolve())
    unittest.main()
