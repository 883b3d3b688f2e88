"""README.md holds the table that tests/bench/quality.py makes of tests/bench/quality.csv."""
import os
import sys
import tempfile
import unittest

import tree

sys.path.insert(0, os.path.join(tree.ROOT, 'tests', 'bench'))
import quality_table  # noqa: E402

CSV = os.path.join(tree.ROOT, 'tests', 'bench', 'quality.csv')
RENEW = 'tests/bench/quality.py --csv tests/bench/quality.csv --table --readme README.md renews it'


def row(**values):
    base = {name: '' for name in quality_table.COLUMNS}
    base.update(version='1', machine='GPU', scene='box', light='its lamp', preset='preview', texels='preset', seed='0',
                asked='0.05', true='0.03', stated='0.04', seconds='4', processor_seconds='9', reference_noise='0.002')
    return {**base, **values}


class Table(unittest.TestCase):
    def test_readme_has_the_table_of_the_csv(self):
        text = tree.read('README.md')
        stands = text.split(quality_table.BEGIN + '\n', 1)[1].split(quality_table.END, 1)[0]
        self.assertEqual(stands, quality_table.table(quality_table.read(CSV)), RENEW)

    def test_seeds_are_a_range_and_a_miss_is_bold(self):
        text = quality_table.table([row(), row(seed='1', true='0.04')])
        self.assertIn('| box, its lamp | 3.0 to 4.0 %, 4.0 s (9.0 s) | 0.2 % |', text)
        self.assertIn('**5.3 %**', quality_table.table([row(true='0.0526')]))
        self.assertNotIn('**', quality_table.table([row(true='0.0524')]))
        self.assertIn('| at most 6.0 %, 4.0 s', quality_table.table([row(true='0.06', reference_noise='0.026')]))

    def test_the_newest_version_of_each_machine_counts(self):
        text = quality_table.table([row(true='0.01'), row(version='2', true='0.02'), row(machine='CPU', true='0.03')])
        self.assertNotIn('1.0 %,', text)
        self.assertIn('2.0 %,', text)
        self.assertIn('3.0 %,', text)

    def test_the_last_row_of_a_seed_counts(self):
        self.assertIn('| 2.0 %, 4.0 s', quality_table.table([row(true='0.01'), row(true='0.02')]))

    def test_rows_are_added_and_found_again(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, 'some.csv')
            for seed in (0, 1):
                quality_table.add(path, row(seed=seed))
            rows = quality_table.read(path)
        self.assertEqual([quality_table.key(r) for r in rows], [quality_table.key(row(seed=s)) for s in (0, 1)])

    def test_only_the_part_between_the_marks_changes(self):
        with tempfile.TemporaryDirectory() as folder:
            page = os.path.join(folder, 'page.md')
            with open(page, 'w') as file:
                file.write('before\n%s\nold\n%s\nafter\n' % (quality_table.BEGIN, quality_table.END))
            quality_table.put(page, [row()])
            with open(page) as file:
                text = file.read()
        self.assertTrue(text.startswith('before\n') and text.endswith('\nafter\n'))
        self.assertNotIn('old', text)


if __name__ == '__main__':
    unittest.main()
