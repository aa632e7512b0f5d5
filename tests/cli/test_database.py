"""Campaigns in a database, from outside: the same answers as from a file, clear refusals, no password anywhere.

usage: test_database.py path/to/lumo path/to/make_store
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

import postgres_server
from refusal import check_refusal

LUMO = MAKE_STORE = ""
USAGE, BAD_FILE = 2, 5


def run(*arguments):
    return subprocess.run(
        [LUMO, *map(str, arguments)], capture_output=True, encoding="utf-8", errors="replace", timeout=600
    )


class WithoutServer(unittest.TestCase):
    def test_addresses(self):
        for address in [
            "postgresql://u:secret@h/d?no_such=1",
            "postgresql://u:se@cret@h/d",
            "postgresql://u:secret@h/d?schema=A",
            "postgresql://u:secret@h:port/d",
        ]:
            for command in ("run", "status", "verify", "export", "select", "report"):
                done = run("campaign", command, "--store", address)
                check_refusal(self, done, USAGE, ["must be postgresql://"])
                self.assertNotIn("cret", done.stderr)
        check_refusal(self, run("study", "void", "--store", "postgresql://h/d"), USAGE, ["studies are kept in files"])

    def test_script(self):
        words = ["--store", "postgresql://ann:secret@db/pads?schema=flat", "--workers", "64"]
        done = run("campaign", "script", "--engine", "slurm", *words, "--time", "8:00:00", "--set", "search.pending=128")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        for line in [
            "#SBATCH --array=1-64\n",
            "#SBATCH --requeue\n",
            "#SBATCH --time=8:00:00\n",
            "#SBATCH --signal=B:USR1@90\n",
            "campaign run --store 'postgresql://ann@db/pads?schema=flat' --threads 1 --set search.pending=128 &\n",
        ]:
            self.assertIn(line, done.stdout)
        self.assertNotIn("secret", done.stdout)
        self.assertEqual(subprocess.run(["sh", "-n"], input=done.stdout, text=True).returncode, 0)
        check_refusal(self, run("campaign", "script", *words), USAGE, ["--engine"])
        check_refusal(self, run("campaign", "script", *words, "--engine", "pbs"), USAGE, ["--engine", "slurm"])
        check_refusal(
            self, run("campaign", "script", *words, "--engine", "slurm", "--time", "soon"), USAGE, ["--time", "'soon'"]
        )

    def test_copy_needs_two_stores(self):
        check_refusal(self, run("campaign", "copy"), USAGE, ["FROM and TO"])
        check_refusal(self, run("campaign", "copy", "a.db"), USAGE, ["FROM and TO"])
        check_refusal(self, run("campaign", "copy", "a.db", "a.db"), USAGE, ["same store"])
        check_refusal(self, run("campaign", "copy", "no_such.db", "b.db"), BAD_FILE, ["no_such.db"])
        self.assertFalse(pathlib.Path("b.db").exists())


class Databases(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.server = postgres_server.Server()
        cls.addClassCleanup(cls.server.close)
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        cls.file = cls.folder / "s.db"
        subprocess.run([MAKE_STORE, cls.file, "DS", "flat", "12"], check=True, timeout=300)
        cls.address = cls.server.address("pads")
        cls.copied = run("campaign", "copy", "--json", cls.file, cls.address)

    def test_copies_are_the_same(self):
        self.assertEqual((self.copied.returncode, self.copied.stderr), (0, ""))
        digest = json.loads(self.copied.stdout)["digest"]
        self.assertEqual(json.loads(run("campaign", "status", "--json", "--store", self.file).stdout)["digest"], digest)
        for command in (["verify"], ["status"], ["export"], ["export", "--json"], ["status", "--json"]):
            file = run("campaign", *command, "--store", self.file)
            database = run("campaign", *command, "--store", self.address)
            self.assertEqual((database.returncode, database.stderr), (0, ""))
            self.assertEqual(database.stdout.replace(self.address, str(self.file)), file.stdout)
        again = run("campaign", "copy", self.file, self.address)  # nothing is lacking
        self.assertIn(digest, again.stdout)
        back = self.folder / "back.db"
        self.assertIn(digest, run("campaign", "copy", self.address, back).stdout)
        self.assertIn(digest, run("campaign", "verify", "--store", back).stdout)

    def test_refusals(self):
        self.server.sql("CREATE ROLE reader LOGIN PASSWORD 'secret-1'")
        self.server.sql("GRANT USAGE ON SCHEMA pads TO reader; GRANT SELECT ON ALL TABLES IN SCHEMA pads TO reader")
        self.server.sql("CREATE SCHEMA mixed; CREATE TABLE mixed.accounts(a int)")
        reader = self.server.address("pads", "reader:secret-1")
        self.assertEqual(run("campaign", "verify", "--store", reader).returncode, 0)
        for store, words in [
            (self.server.address("pads", "reader:secret-wrong"), ["password authentication failed"]),
            (self.server.address("pads", database="nowhere"), ['"nowhere" does not exist']),
            (self.server.address("mixed"), ["'mixed' is not a store of lumo"]),
            ("postgresql://ann:secret@/d?host=/no/such/folder", ["/no/such/folder"]),
        ]:
            for command in ("status", "verify", "export", "run"):
                done = run("campaign", command, "--store", store)
                check_refusal(self, done, BAD_FILE, words)
                self.assertNotIn("secret", done.stderr)
        check_refusal(
            self, run("campaign", "status", "--store", self.server.address("other")), BAD_FILE, ["no schema 'other'"]
        )
        check_refusal(self, run("campaign", "run", "--store", self.address), BAD_FILE, ["belongs to another problem"])
        check_refusal(self, run("campaign", "copy", self.file, reader), BAD_FILE, ["'reader' may read it, not write"])
        self.assertNotIn("secret", run("campaign", "status", "--store", reader).stdout)


if __name__ == "__main__":
    LUMO, MAKE_STORE = (str(pathlib.Path(p).resolve()) for p in (sys.argv.pop(1), sys.argv.pop(1)))
    unittest.main()
