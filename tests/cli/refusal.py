"""What every refusal of the program is: an exit code, nothing on standard output, and one line that says what, value
and limit."""


def check_refusal(test, done, code, words):
    test.assertEqual(done.returncode, code, done.stderr)
    test.assertEqual(done.stdout, "")
    test.assertEqual(done.stderr.count("\n"), 1, done.stderr)
    test.assertTrue(done.stderr.startswith("lumo: "), done.stderr)
    for word in words:
        test.assertIn(word, done.stderr)
