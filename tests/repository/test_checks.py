"""The checks must fail where they should: each planted fault is found, and clean code is left in peace."""

import json
import os
import pathlib
import shutil
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
sys.dont_write_bytecode = True
import check_cost  # noqa: E402
import check_format  # noqa: E402
import check_headers  # noqa: E402
import check_house  # noqa: E402
import check_includes  # noqa: E402
import check_names  # noqa: E402
import check_vocabulary  # noqa: E402
import compare_bits  # noqa: E402
import cpp  # noqa: E402


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
        self.plant("fabrication/e.hpp", "double stem_height; // of the finger\n")
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

    def test_rooms_inside_rooms(self):
        self.plant("mechanics/contact/c.hpp", '#include "lumo/mesh/b.hpp"\n')
        self.plant("mechanics/d.hpp", '#include "lumo/mechanics/contact/c.hpp"\n')
        self.assertEqual(check_includes.check(self.root), [])
        self.plant("mechanics/contact/bad.hpp", '#include "lumo/mechanics/d.hpp"\n')
        self.one_fault(check_includes.check, "mechanics/contact must not include mechanics (")

    def test_details_belong_to_their_room(self):
        self.plant("mesh/detail/d.hpp", '#include "lumo/core/a.hpp"\n')
        self.plant("mesh/e.hpp", '#include "lumo/mesh/detail/d.hpp"\n')
        self.assertEqual(check_includes.check(self.root), [])
        self.plant("objective/bad.hpp", '#include "lumo/mesh/detail/d.hpp"\n')
        faults = check_includes.check(self.root)
        self.assertEqual(len(faults), 2, faults)
        self.assertIn("is a detail", faults[0])

    def test_rooms_stand_below_those_that_they_include(self):
        seen = set()
        for room, others in check_includes.ROOMS.items():
            seen.add(room)
            above = {
                o
                for o in others.split()
                if o not in seen and not o.startswith(room + "/") and not room.startswith(o + "/")
            }
            self.assertEqual(above, set(), room)

    def test_unknown_folder(self):
        self.plant("misc/bad.hpp", "\n")
        self.one_fault(check_includes.check, "is no room")

    def test_ring(self):
        self.plant("core/x.hpp", '#include "lumo/core/y.hpp"\n')
        self.plant("core/y.hpp", '#include "lumo/core/x.hpp"\n')
        self.one_fault(check_includes.check, "include each other")

    def test_vocabulary(self):
        for line in [
            "double h_fp;",
            "double h_ep = 1;",
            "double w_s;",
            "double h_s_m;",
            "auto w_v = 0;",
            "// above the stem",
            "int stem_top;",
            "int on_stem;",
            "struct StemFace {};",
            "int void_roof;",
            "int has_void;",
            "bool no_void;",
            "// light in a lateral void",
            "// leaves into a void",
            "// the voids",
        ]:
            with self.subTest(line):
                self.plant("optics/bad.hpp", line + "\n")
                self.one_fault(check_vocabulary.check, "belongs to fabrication or morphology")

    def test_headers_alone(self):
        compiler = os.environ.get("CXX") or shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
        folders = [self.folder.name]
        (self.root / "mesh/b.hpp").unlink()
        faults, total = check_headers.check(compiler, folders)
        self.assertEqual((faults, total), ([], 1))
        for name, text in [
            ("forgets an include", "#pragma once\nstd::string s();\n"),
            ("lacks a guard", "struct S {};\n"),
            ("warns", "#pragma once\ninline int f(int x) { int y; return x; }\n"),
        ]:
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

        good = """struct HeldState { double force_N; double stiffness_N_per_m3; };
                  struct Motor { double torque_constant_Nm_per_A; double J_contact; };
                  enum class Kind { voltage_V, held_state };
                  class Sum { double total_N_ = 0.0; double parts_ = 0.0;
                  public: double total_N() const { return total_N_ + parts_; } };
                  constexpr double operator""_kPa(long double value) { return 1e3 * double(value); }
                  template <class Shape_> struct Held { using Shape = Shape_; };"""
        self.assertEqual(faults(good), [])
        for text in [
            "struct held_state {};",
            "struct S { double forceN; };",
            "class C { double total = 0.0; };",
            "inline void doIt() {}",
            "inline int f(int Count) { return Count; }",
            "enum class Kind { Held };",
            "namespace Inner { struct S {}; }",
            "using held = int;",
            "template <class shape> struct S {};",
        ]:
            with self.subTest(text):
                self.assertEqual(len(faults(text)), 1)

    def test_cost(self):
        recorded = {"evaluate used": {"functions": 1000, "classes": 100}}
        self.assertEqual(check_cost.compare({"evaluate used": {"functions": 1030, "classes": 50}}, recorded), [])
        faults = check_cost.compare({"evaluate used": {"functions": 1031, "classes": 103}}, recorded)
        self.assertEqual(len(faults), 1)
        self.assertIn("evaluate used: instantiates 1031 functions, recorded are 1000", faults[0])
        self.assertIn("no count", check_cost.compare({"observe used": {"functions": 1}}, recorded)[0])


class House(unittest.TestCase):
    """Faults that check_house.py must find, and code that it must leave in peace."""

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.root = pathlib.Path(self.folder.name)
        for top in check_house.CODE_FOLDERS + ["docs"]:
            (self.root / top).mkdir()
        self.plant("README.md", "# lumo\n")
        self.plant_map("  core/    units\n")
        self.plant("include/lumo/core/a.hpp", "#pragma once\n")

    def plant(self, name, text):
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def plant_map(self, rooms):
        self.plant("CONTRIBUTING.md", f"# lumo\n\n```\ninclude/lumo/\n{rooms}tests/\n```\n")

    def faults(self, kind, text, name="include/lumo/core/a.hpp"):
        self.plant(name, text)
        found = check_house.check(self.root)
        self.assertEqual([k for k, faults in found.items() if faults and k != kind], [], found)
        return found[kind]

    def passes(self, text):
        self.assertEqual(self.faults("lines", text), [])

    def fails(self, kind, text, words, name="include/lumo/core/a.hpp", line=1):
        with self.subTest(text[:80]):
            found = self.faults(kind, text, name)
            self.assertEqual(len(found), 1, found)
            self.assertIn(words, found[0])
            self.assertTrue(found[0].startswith(f"{name}:{line}:"), found[0])

    def test_lines(self):
        self.passes("// " + 117 * "µ" + "\n")
        for folder in check_house.CODE_FOLDERS:
            self.fails("lines", "\n// " + 118 * "x" + "\n", "(121 columns, 120)", f"{folder}/lumo/core/a.hpp", 2)
            self.plant(f"{folder}/lumo/core/a.hpp", "\n")

    def test_functions(self):
        body = "{\n" + 58 * "  g();\n" + "}\n"
        heads = [
            "void f() ",
            "template <class T>\n  requires std::same_as<T, int> && (sizeof(T) == 4)\nauto f(T x) -> decltype(x) ",
            "struct S {\n  S() : a_(1), b_{2} ",
            "X<T>::X(int a) : a_{a}, X<int>(b) ",
            "bool operator<(const S& a, const S& b) ",
            "int S::operator()(int a) const noexcept(true) ",
            'TEST_CASE("a", "[b]") ',
            "namespace lumo {\nstatic constexpr std::vector<int> f(std::array<int, (3 > 2)> a = {}) ",
        ]
        for head in heads:
            end = "};\n" if "struct S {\n" in head else "}\n" if "namespace" in head else ""
            with self.subTest(head):
                self.assertEqual(self.faults("functions", head + body + end), [])
                longer = body.replace("  g();\n", "  g();\n  // one more\n", 1)
                self.assertEqual(len(self.faults("functions", head + longer + end)), 1)
        self.fails(
            "functions",
            "struct S {\n  void f() {\n" + 60 * "\n" + "  }\n};\n",
            "function f is too long (62 lines, 60)",
            line=2,
        )

    def test_names_of_tests(self):
        self.passes('TEST_CASE("a, b", "[c]") {\n  f();\n}\n')
        self.fails("test names", '\nTEST_CASE("a; b", "[c]") {\n}\n', "semicolon, at which CTest", line=2)

    def test_parameters(self):
        self.passes(
            "void f(std::map<int, int> a, int b, int c, int d, int e, std::function<void(int, int)> f = {1, 2});\n"
        )
        for text in [
            "void f(int a, int b, int c, int d, int e, int f, int g);\n",
            "struct S {\n  S(int a, int b, int c, int d, int e, int f, int g) : a_(a) {}\n};\n",
            "auto f() {\n  return [&](int a, int b, int c, int d, int e, int f, int g) mutable { return a; };\n}\n",
        ]:
            self.fails("parameters", text, "(7 parameters, 6)", line=1 if text.startswith("void") else 2)

    def test_rooms(self):
        for k in range(13):
            self.plant(f"include/lumo/core/x{k}.hpp", "\n")
        self.passes("\n")
        self.plant("include/lumo/core/one_more.hpp", "\n")
        self.assertIn("include/lumo/core:1: room has too much in it (15 headers, 14)", self.faults("rooms", "\n"))
        (self.root / "include/lumo/core/one_more.hpp").unlink()
        self.plant_map("  core/    units\n  misc/    b\n")
        self.plant("include/lumo/misc/b.hpp", "\n")
        self.assertIn("no such room", self.faults("rooms", "\n")[0])

    def test_details(self):
        self.passes("int f() { return detail::g(); }\n")
        for folder in ["examples", "tests", "benchmarks"]:
            for text in [
                "int f() { return lumo::detail::g(); }\n",
                "int f() { return detail::g(); }\n",
                "using namespace lumo::sense::detail;\n",
                '#include "lumo/optics/detail/x.hpp"\n',
            ]:
                self.fails("details", text, "outside", f"{folder}/a.cpp")
            self.plant(f"{folder}/a.cpp", "int f() { return nlohmann::detail::g(); }  // detail::\n")

    def test_words(self):
        self.passes('// To ask and tell.\nauto c = "study readings";  StudyReadings s;  // how to read; dearth\n')
        for text in [
            "// what is " + "told\n",
            "// it tells " + "which\n",
            "// dearer to compile\n",
            "// Nothing where it fails.\n",
            "double Firmness = 1;\n",
            "int touch_down();\n",
            "struct Lanes;\n",
            "Draws draws(1);\n",
            "int carrier_exchange;\n",
            "bool border() const;\n",
            "// other readings\n",
        ]:
            self.fails("words", text, "write ")
        self.passes("\n")
        for name in ["docs/a.md", "README.md", "tests/a.py"]:
            self.fails("words", "is told\n", "write ", name)
            self.plant(name, "\n")
        self.plant("CHANGELOG.md", "is told\n")
        self.passes("\n")

    def test_paths(self):
        self.plant("tests/core/b_laws.hpp", "\n")
        self.plant("docs/manual.md", "`lumo/core/a.hpp`, core/a.hpp, include/lumo/core/a.hpp, `a.hpp`, `b_laws.hpp`\n")
        self.plant("README.md", "[a](docs/manual.md), `tests/core/`, tests/<room>/, cmake/copyright.*.in, out/a.csv\n")
        self.passes("\n")
        for page in ["docs/pages/a.md", "README.md", "benchmarks/a.md"]:
            for path in ["lumo/mesh/a.hpp", "core/c.hpp", "c.hpp", "tests/mesh/run", "docs/none.md"]:
                self.fails("paths", f"\nSee `{path}`.\n", f"no such file: {path}", page, 2)
            self.plant(page, "\n")

    def test_map(self):
        self.plant("include/lumo/mesh/detail/d.hpp", "\n")
        self.plant("include/lumo/mesh/m.hpp", "\n")
        self.plant("include/lumo/mechanics/contact/c.hpp", "\n")
        self.plant("include/lumo/mechanics/solvers/s.hpp", "\n")
        whole = "  core/       units\n  mesh/       tetrahedra  \n"
        inner = "  mechanics/  presses\n    contact/  laws  solvers/  equilibrium\n"
        self.plant_map(whole + inner)
        self.passes("\n")
        for rooms, words in [
            ("  core/  units\n" + inner, "lacks the room mesh"),
            (whole + inner.replace("solvers/", "solving "), "lacks the room mechanics/solvers"),
            (whole + inner + "  optics/  light\n", "a room that is not there: optics"),
            (whole + inner + 26 * "    more\n", "map is too long (32 lines, 30)"),
        ]:
            self.plant_map(rooms)
            found = self.faults("map", "\n")
            self.assertEqual(len(found), 1, found)
            self.assertIn(words, found[0])
        self.plant("CONTRIBUTING.md", "# lumo\n")
        self.assertIn("has no map", self.faults("map", "\n")[0])

    def test_comma_chains(self):
        self.passes(
            "void f() {\n"
            "  double a = 1, b = 2;\n"
            "  for (int i = 0, j = 1; i < j; ++i, ++j) g(a = 1, b = 2);\n"
            "  std::pair<int, int> c = h({.x = 1, .y = 2}), *d = &c;\n"
            "  auto [x, y] = c;\n"
            "}\n"
        )
        for text in [
            "a = 1, b = 2;",
            "if (a) a.x = 1, b[2] = 3;",
            "a += b * c.d, e -= 1;",
            "for (;;) i++, j += 2;",
            "g([&](int c) { c = 1, *b = 2; });",
            "case 1: a = 1, b = 2;",
        ]:
            self.fails("comma chains", "void f() {\n  " + text + "\n}\n", "chained", line=2)

    def test_phantom_parameters(self):
        self.passes(
            "template <class T, class S = double> S f(const T& x);\n"
            "double y = f<int, float>(1);\n"
            "template <int N> double g(std::span<double, N> v);\n"
            "template <class T> struct X { template <class U> X(U u) : u_(u) {} T get() const; };\n"
            "template <class T> T X<T>::get() const { return {}; }\n"
            "template <class To> To cast(double x);\n"
            "auto z = cast<int>(2.0) + s.template turn<3>();\n"
            "struct S { template <int K> int turn() const; template <class T> operator T() const; };\n"
        )
        for text in [
            "template <class = void>\nvoid f();\n",
            "template <class Vec3 = Vec3>\nVec3 f(int a);\n",
            "template <class VectorXd = Eigen::VectorXd>\nvoid f(const VectorXd& x);\n",
            "template <class T>\nint f();\n",
            "template <class T>\nint f(typename T::type x);\n",
            "template <class M, int>\nvoid f(M);\n",
            "template <class T = void>\nstruct S {};\n",
            "template <class T = int>\nclass ModelOf {};\n",
        ]:
            self.fails("phantom parameters", text, "", line=2 if "ModelOf" in text else 1)
        for text in ["void f(In<double> x);\n", "using Vec = Dependent<Vec3, T>;\n", "using Model = ModelOf<>;\n"]:
            self.fails("phantom parameters", text, "hides a type")

    def test_reader(self):
        reader = cpp.Reader(
            '/* { */ const char* s = R"x({ "a" )x";  // {\n'
            "#define F(x) { \\\n {\n"
            "namespace a::b {\n"
            "enum class E : int { x, y };\n"
            "class C final : public B<(1 > 0)> {\n"
            " public:\n"
            "  explicit(true) C(int);\n"
            "  ~C() {}\n  int f() const& { return 1'000; }\n  X x{1};\n};\n}\nint main() {}\n"
        )
        self.assertEqual(
            [(d.kind, d.name) for d in reader.declarations],
            [("type", "C"), ("function", "C"), ("function", "~C"), ("function", "f"), ("function", "main")],
        )
        self.assertEqual([d.line for d in reader.declarations], [6, 8, 9, 10, 14])


class Format(unittest.TestCase):
    @unittest.skipUnless(check_format.version("clang-format") == check_format.VERSION, "needs clang-format")
    def test_format(self):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            (root / "include").mkdir()
            shutil.copy(pathlib.Path(__file__).parents[2] / ".clang-format", root)
            (root / "include/a.hpp").write_text("#pragma once\n\nint f(int a);\n")
            self.assertEqual(check_format.check("clang-format", root), [])
            (root / "include/a.hpp").write_text("#pragma once\n\nint f( int a );\nint  g();\n")
            found = check_format.check("clang-format", root)
            self.assertEqual(len(found), 1)
            self.assertIn("include/a.hpp:3: not as clang-format writes it", found[0])

    def test_without_the_tool(self):
        self.assertEqual(check_format.version("no-such-clang-format"), 0)


class Bits(unittest.TestCase):
    """compare_bits.py over two made-up records."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.record, self.run_folder = pathlib.Path(folder.name) / "record", pathlib.Path(folder.name) / "run"
        for root, seconds in [(self.record, 1.5), (self.run_folder, 2.5)]:
            (root / "press").mkdir(parents=True)
            (root / "press.stdout").write_text(json.dumps({"depth_mm": [1.25, 2.5], "seconds": {"total": seconds}}))
            (root / "press.exit").write_text("0\n")
            (root / "press" / "press.csv").write_text(f"load_N,seconds\n1,{seconds}\n")
            (root / "press" / "frame.png").write_bytes(b"pixels")
        (self.record / "record.json").write_text(
            json.dumps({"commands": ["press"], "digests": compare_bits.keep(self.record)})
        )

    def differences(self, **options):
        return compare_bits.compare(self.record, self.run_folder, None, **options)

    def test_the_clock_is_no_difference(self):
        self.assertEqual(self.differences(), [])

    def test_each_difference_is_found(self):
        for name, text, words in [
            (
                "press.stdout",
                '{"depth_mm": [1.25, 2.5000000000000004], "seconds": 1}',
                "depth_mm[1] = 2.5000000000000004",
            ),
            ("press.exit", "4\n", "+ 4"),
            ("press/press.csv", "load_N,seconds\n2,1\n", "+ 2"),
            ("press/frame.png", "pixelz", "other bytes"),
            ("press/more.csv", "a\n", "was not written before"),
        ]:
            with self.subTest(name):
                path = self.run_folder / name
                before = path.read_bytes() if path.exists() else None
                path.write_text(text)
                found = self.differences()
                self.assertEqual(len(found), 1, found)
                self.assertIn(words, found[0])
                path.unlink() if before is None else path.write_bytes(before)
        (self.run_folder / "press/press.csv").unlink()
        self.assertIn("no longer written", self.differences()[0])

    def test_words_may_differ_and_numbers_not(self):
        for root, text in [(self.record, "what is kept: 3 mm\n"), (self.run_folder, "kept are 3 mm\n")]:
            (root / "press.stdout").write_text(text)
        self.assertEqual(len(self.differences()), 1)
        self.assertEqual(self.differences(words_may_differ=True), [])
        (self.run_folder / "press.stdout").write_text("kept are 4 mm\n")
        self.assertEqual(len(self.differences(words_may_differ=True)), 1)


if __name__ == "__main__":
    unittest.main()
