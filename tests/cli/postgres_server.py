"""A PostgreSQL server of the test's own: in a temporary folder, on a Unix socket there, and as a user of its own where
the test runs as root, which the server refuses."""

import os
import pathlib
import pwd
import shutil
import subprocess
import tempfile
import time
import unittest

FOLDERS = [f"/usr/lib/postgresql/{version}/bin" for version in (17, 16, 15, 14, 13)] + ["/usr/pgsql/bin"]


def programs():
    found = shutil.which("initdb", path=os.pathsep.join([*FOLDERS, os.environ.get("PATH", "")]))
    return pathlib.Path(found).resolve().parent if found else None


class Server:
    """Role lumo owns it and needs no password, all others do."""

    def __init__(self):
        self.programs = programs()
        if self.programs is None:
            raise unittest.SkipTest("PostgreSQL is not installed (package postgresql-15)")
        self.user = None
        if os.geteuid() == 0:
            known = {u.pw_name for u in pwd.getpwall()}
            self.user = next((name for name in ("postgres", "nobody") if name in known), None)
            if self.user is None:
                raise unittest.SkipTest("the test runs as root, and there is no user postgres or nobody")
        self.folder = tempfile.TemporaryDirectory(prefix="lumo-")
        os.chmod(self.folder.name, 0o711)
        inner = pathlib.Path(self.folder.name) / "server"
        inner.mkdir()
        if self.user:
            shutil.chown(inner, self.user)
        self.data = inner / "data"
        self.run("initdb", "--pgdata", self.data, "--username", "lumo", "--auth", "trust", "--no-sync", "--locale", "C",
                 "--encoding", "UTF8")
        (self.data / "pg_hba.conf").write_text("local all lumo trust\nlocal all all scram-sha-256\n")
        self.process = None
        self.start()

    def start(self):
        self.process = subprocess.Popen(
            [self.programs / "postgres", "-D", self.data, "-k", self.data, "-c", "listen_addresses=", "-c", "fsync=off"],
            user=self.user, cwd="/", stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        for _ in range(600):
            if subprocess.run([self.programs / "psql", *self.own(), "-c", "SELECT 1"], capture_output=True).returncode == 0:
                return
            time.sleep(0.05)
        raise RuntimeError("PostgreSQL does not start")

    def own(self):
        return ["-X", "-q", "-h", str(self.data), "-U", "lumo", "-d", "postgres"]

    def run(self, program, *words):
        subprocess.run([self.programs / program, *map(str, words)], check=True, user=self.user, cwd="/",
                       stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)

    def sql(self, text):
        self.run("psql", *self.own(), "-v", "ON_ERROR_STOP=1", "-c", text)

    def address(self, schema="lumo", who="lumo", database="postgres"):
        return f"postgresql://{who}@/{database}?host={self.data}&schema={schema}"

    def close(self):
        self.process.send_signal(3)  # SIGQUIT: at once
        self.process.wait()
        self.folder.cleanup()
