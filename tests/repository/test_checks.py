"""The checks must fail where they should: each planted fault is found, and clean code is left in peace."""
import os
import pathlib
import shutil
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
sys.dont_write_bytecode = True
import check_cost  # noqa: E402
import check_headers  # noqa: E402
import check_includes  # noqa: E402
import check_names  # noqa: E402
import check_vocabulary  # noqa: E402


class Checks(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.root = pathlib.Path(self.folder.name) / "lumo"
        self.plant("core/a.hpp", "#pragma once\n#include <vector>\n")
        self.plant("mesh/b.hpp", '#pragma once\n#include "lumo/core/a.hpp"\n#include <Eigen/Core>\n')

    def plant(self, name, text):
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def one_fault(self, check, words):
        faults = check(self.root)
        self.assertEqual(len(faults), 1, faults)
        self.assertIn(words, faults[0])

    def test_clean_tree_passes(self):
        self.plant("mechanics/c.hpp", "void f(void* p);\nusing T = std::void_t<int>;\n// the system, returns void\n")
        self.plant("morphology/d.hpp", "double h_fp; // the stem and its voids\n")
        self.assertEqual(check_includes.check(self.root), [])
        self.assertEqual(check_vocabulary.check(self.root), [])

    def test_empty_tree_fails(self):
        self.assertTrue(check_includes.check(self.root / "nothing"))
        self.assertTrue(check_vocabulary.check(self.root / "nothing"))

    def test_arrow_backwards(self):
        self.plant("core/bad.hpp", '#include "lumo/mesh/b.hpp"\n')
        self.one_fault(check_includes.check, "core must not include mesh")

    def test_optimiser_knows_core_only(self):
        self.plant("optimize/bad.hpp", '#include "lumo/mesh/b.hpp"\n')
        self.one_fault(check_includes.check, "optimize must not include mesh")

    def test_nobody_includes_an_adapter(self):
        self.plant("support/tetgen.hpp", '#include "lumo/mesh/b.hpp"\n#include <tetgen.h>\n')
        self.plant("lumo.hpp", '#include "lumo/support/tetgen.hpp"\n')
        self.one_fault(check_includes.check, "the umbrella must not include support")

    def test_foreign_library_outside_support(self):
        self.plant("optics/bad.hpp", "#include <embree3/rtcore.h>\n")
        self.one_fault(check_includes.check, "only support/")

    def test_missing_and_relative_headers(self):
        self.plant("core/bad.hpp", '#include "lumo/core/nowhere.hpp"\n')
        self.one_fault(check_includes.check, "no such header")
        self.plant("core/bad.hpp", '#include "a.hpp"\n')
        self.one_fault(check_includes.check, "path from the include folder")

    def test_dear_header_behind_lumo(self):
        self.plant("core/clock.hpp", "#include <chrono>\n")
        self.assertEqual(check_includes.check(self.root), [])
        self.plant("lumo.hpp", '#include "lumo/core/clock.hpp"\n')
        self.one_fault(check_includes.check, "must not include <chrono>")

    def test_unknown_folder(self):
        self.plant("misc/bad.hpp", "\n")
        self.one_fault(check_includes.check, "no stage")

    def test_ring(self):
        self.plant("core/x.hpp", '#include "lumo/core/y.hpp"\n')
        self.plant("core/y.hpp", '#include "lumo/core/x.hpp"\n')
        self.one_fault(check_includes.check, "include each other")

    def test_vocabulary(self):
        for line in ["double h_fp;", "double h_ep = 1;", "double w_s;", "double h_s_m;", "auto w_v = 0;", "// above the stem", "int stem_top;", "int on_stem;",
                     "struct StemFace {};", "int void_roof;", "int has_void;", "bool no_void;", "// light in a lateral void", "// leaves into a void", "// the voids"]:
            with self.subTest(line):
                self.plant("optics/bad.hpp", line + "\n")
                self.one_fault(check_vocabulary.check, "belongs to morphology/")

    def test_headers_alone(self):
        compiler = os.environ.get("CXX") or shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
        folders = [self.folder.name]
        (self.root / "mesh/b.hpp").unlink()
        faults, total = check_headers.check(compiler, folders)
        self.assertEqual((faults, total), ([], 1))
        for name, text in [("forgets an include", "#pragma once\nstd::string s();\n"), ("lacks a guard", "struct S {};\n"), ("warns", "#pragma once\ninline int f(int x) { int y; return x; }\n")]:
            with self.subTest(name):
                self.plant("core/bad.hpp", text)
                faults, _ = check_headers.check(compiler, folders)
                self.assertEqual(len(faults), 1)
                self.assertIn("core/bad.hpp", faults[0])

    def test_headers_cache(self):
        compiler = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
        (self.root / "mesh/b.hpp").unlink()
        cache = self.root.parent / "cache.json"
        self.assertEqual(check_headers.check(compiler, [self.folder.name], cache)[0], [])
        self.plant("core/a.hpp", "#pragma once\nstd::string s();\n")
        self.assertEqual(len(check_headers.check(compiler, [self.folder.name], cache)[0]), 1)
        self.assertEqual(len(check_headers.check(compiler, [self.folder.name], cache)[0]), 1)

    @unittest.skipUnless(shutil.which("clang-tidy"), "needs clang-tidy")
    def test_names(self):
        rules = pathlib.Path(__file__).parent.parent.parent / ".clang-tidy"

        def faults(text):
            self.plant("mesh/b.hpp", f"#pragma once\nnamespace lumo {{\n{text}\n}}\n")
            return check_names.check("clang-tidy", rules, [self.folder.name])[0]

        good = """struct HeldState { double force_N; double stiffness_N_per_m3; double torque_constant_Nm_per_A; double J_contact; };
                  enum class Kind { voltage_V, held_state };
                  class Sum { double total_N_ = 0.0; double parts_ = 0.0; public: double total_N() const { return total_N_ + parts_; } };
                  constexpr double operator""_kPa(long double value) { return 1e3 * double(value); }
                  template <class Shape_> struct Held { using Shape = Shape_; };"""
        self.assertEqual(faults(good), [])
        for text in ["struct held_state {};", "struct S { double forceN; };", "class C { double total = 0.0; };", "inline void doIt() {}", "inline int f(int Count) { return Count; }",
                     "enum class Kind { Held };", "namespace Inner { struct S {}; }", "using held = int;", "template <class shape> struct S {};"]:
            with self.subTest(text):
                self.assertEqual(len(faults(text)), 1)

    def test_cost(self):
        recorded = {"lumo": {"functions": 1000, "classes": 100}}
        self.assertEqual(check_cost.compare({"lumo": {"functions": 1030, "classes": 50}}, recorded), [])
        faults = check_cost.compare({"lumo": {"functions": 1031, "classes": 103}}, recorded)
        self.assertEqual(len(faults), 1)
        self.assertIn("lumo.cpp instantiates 1031 functions, recorded are 1000", faults[0])


if __name__ == "__main__":
    unittest.main()
