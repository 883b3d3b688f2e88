"""kiln bench stability: rows hold, rows that cannot hold are told apart, and names of rows are checked."""
import json
import os
import subprocess
import tempfile
import unittest

KILN = os.environ['KILN']


def bench(*arguments):
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.run([KILN, 'bench', 'stability', *arguments], stdout=subprocess.PIPE,
                                 stderr=subprocess.PIPE, text=True, env={**os.environ, 'TMPDIR': folder})
        return process, os.listdir(folder)


class Stability(unittest.TestCase):
    def test_rows_hold(self):
        process, left = bench('half-floats', 'not-a-number', 'mirror', '--json', '--schedule', 'equal',
                              '--samples-direct', '512', '--samples-indirect', '64')
        self.assertEqual(process.returncode, 0, process.stdout + process.stderr)
        table = json.loads(process.stdout)
        self.assertEqual([row['holds'] for row in table['rows']], [True] * len(table['rows']))
        self.assertEqual({row['row'] for row in table['rows']}, {'half-floats', 'not-a-number', 'mirror'})
        self.assertEqual(table['rows_that_do_not_hold'], 0)
        self.assertEqual(left, [], 'the temporary folder is left behind')

    def test_rows_that_do_not_hold(self):
        """With one sample the error is above what the rows allow."""
        process, _ = bench('mirror', '--samples-direct', '1', '--json')
        self.assertEqual(process.returncode, 70, process.stderr)
        table = json.loads(process.stdout)
        self.assertEqual([row['holds'] for row in table['rows']], [False] * len(table['rows']), table)
        self.assertIn('do not hold', process.stderr)

    def test_names(self):
        process, _ = bench('silvers')
        self.assertEqual(process.returncode, 64)
        self.assertIn('slivers', process.stderr)


if __name__ == '__main__':
    unittest.main()
