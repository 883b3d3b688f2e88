"""GLSL that follows C by hand. A shader that does names the C file in its first comment. The lines of such shaders are
printed, and must not become more: what both processors do belongs into a header of shaders/shared."""
import re
import unittest

import tree

MOST = 4173  # lines; lower it with each pair that is written once

FIRST_COMMENT = re.compile(r'/\*.*?\*/', re.S)
C_FILE = re.compile(r'[\w/]+\.c\b')


def followers():
    """Shaders that follow C files, with their lines and these files."""
    for path in tree.tracked():
        if path.startswith('shaders/') and tree.SOURCES.search(path) and not path.endswith('.h') and \
                not path.startswith('shaders/compile/'):
            text = tree.read(path)
            comment = FIRST_COMMENT.search(text)
            names = C_FILE.findall(comment.group()) if comment else []
            if names:
                yield path, text.count('\n'), names


class WrittenOnce(unittest.TestCase):

    def test_lines(self):
        found = list(followers())
        lines = sum(count for _, count, _ in found)
        for path, count, names in found:
            print(f'{count:5d} {path}: {" ".join(names)}')
        print(f'{lines:5d} lines of GLSL in {len(found)} files follow C')
        self.assertLessEqual(lines, MOST, 'more lines of GLSL follow C by hand: write what both do in shaders/shared')

    def test_names(self):
        """What shaders say that they follow is there."""
        names = {path.rsplit('/', 1)[1] for path in tree.tracked() if path.endswith('.c')}
        missing = [f'{path}: {name}' for path, _, files in followers() for name in files
                   if name.rsplit('/', 1)[-1] not in names]
        self.assertEqual([], missing)


if __name__ == '__main__':
    unittest.main()
