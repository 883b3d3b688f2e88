"""What every text of the repository keeps to: at most 120 columns, maps of rooms that are short, and citations that a
reader of the repository can follow."""
import os
import re
import shlex
import subprocess
import textwrap
import unittest

import tree

COLUMNS = 120
MAP_LINES = 150
KINDS = re.compile(r'(\.(c|h|cpp|comp|glsl|rahit|rchit|rmiss|py|sh|js|md|yaml|yml|cmake)'
                   r'|CMakeLists\.txt|CMakePresets\.json|\.clang-format|cluster/packages)$')
# Pages of the place where kiln was planned, which its readers do not have.
PAGES = ('DES' 'IGN', 'HAB' 'ITS', 'PERF' 'ORMANCE', 'USE' 'RS', 'RELIA' 'BILITY', 'ST' 'ACK')
ELSEWHERE = re.compile(r'\b(' + '|'.join(PAGES) + r')(\.md\b| section\b| finding\b|,? says\b|\s+asks\b|\b\s*§)'
                       r'|/wo' + r'rk/')
# A file that a text names: by its path, or a page or header by its name alone.
NAMED = re.compile(r'(?<![\w./<-])((?:coordinator|worker|shaders|tests|cluster|jobs)/[\w./-]*'
                   r'\.(?:c|h|cpp|comp|glsl|py|md|txt)|[A-Z]+\.md)\b')
# A line of what git says of a commit, and a command that made it say so with the lines that follow.
OF_COMMIT = re.compile(r' +[\w./-]+ +\| +\d+ [+-]+')
QUOTED = re.compile(r'^    \$ (git show .*)\n((?:    .*\n|\n(?=    ))*)', re.M)
# A source that a comment names by its name alone, and those of libraries.
COMMENT = re.compile(r'/\*.*?\*/|//[^\n]*', re.S)
# A comment that begins with one of these words has not said what the thing is.
FIRST_WORDS = re.compile(r'^(?:/\*+|//)\s*(That|What|Of|It|How many)\b')
SOURCE = re.compile(r'(?<![\w<"/.-])([a-z_]\w{2,}\.(?:h|glsl|comp|c))\b')
LIBRARIES = {'cmocka.h', 'rtcore_ray.h', 'sysexits.h'}
BUILT = re.compile(r'^shaders/\w+\.h$|^tests/\w+\.h$')


def texts():
    """{path: text} of all tracked texts that people write."""
    result = {}
    for path in tree.tracked():
        if KINDS.search(path) or os.path.splitext(path)[1] == '' and tree.read(path).startswith('#!'):
            if not path.startswith(('tests/data/', 'tests/fuzz/corpus/')):
                result[path] = tree.read(path)
    return result


def is_long(path, line):
    """A table of a page and a line that an address makes long cannot be folded."""
    if len(line) <= COLUMNS:
        return False
    return not (path.endswith('.md') and (line.startswith('|') or re.search(r'https?://\S{60,}', line)))


def long_lines(files):
    for path, text in files.items():
        for number, line in enumerate(text.splitlines(), 1):
            if is_long(path, line):
                yield f'{path}:{number}: {len(line)} columns; at most {COLUMNS}'


def far_citations(files):
    for path, text in files.items():
        for number, line in enumerate(text.splitlines(), 1):
            match = ELSEWHERE.search(line)
            if match:
                yield f"{path}:{number}: '{match.group(0)}' is not in the repository: cite a README.md or a paper"


def long_maps(files):
    """README.md files of rooms that take more than five minutes to read."""
    for path, text in files.items():
        if path.endswith('/README.md') and len(text.splitlines()) >= MAP_LINES:
            yield (f'{path}: {len(text.splitlines())} lines; the map of a room has less than {MAP_LINES}: what was '
                   'measured and tried goes to NOTES.md beside it')


def lost_names(files, known):
    """Files that texts name and that are not there; `known` holds all paths."""
    names = {os.path.basename(path) for path in known}
    for path, text in files.items():
        for number, line in enumerate(text.splitlines(), 1):
            for name in () if OF_COMMIT.fullmatch(line) else NAMED.findall(line):  # a commit names files as they were
                near = {name, os.path.join(os.path.dirname(path), name)}
                if not near & known and not BUILT.search(name) and 'NAME' not in name and \
                        ('/' in name or name not in names):
                    yield f'{path}:{number}: there is no {name}'


def lost_sources(files, known):
    """Sources that comments of C and GLSL name and that are not there."""
    names = {os.path.basename(path) for path in known} | LIBRARIES
    for path, text in files.items():
        if tree.SOURCES.search(path):
            for comment in COMMENT.finditer(text):
                for name in SOURCE.finditer(comment.group(0)):
                    if name.group(1) not in names:
                        line = text.count('\n', 0, comment.start() + name.start()) + 1
                        yield f'{path}:{line}: there is no {name.group(1)}'


def vague_comments(files):
    """Comments of C and GLSL that do not begin with the thing."""
    for path, text in files.items():
        if tree.SOURCES.search(path):
            for comment in COMMENT.finditer(text):
                word = FIRST_WORDS.search(comment.group(0))
                if word:
                    line = text.count('\n', 0, comment.start()) + 1
                    yield f"{path}:{line}: a comment begins with '{word.group(1)}': say first what the thing is"


class Texts(unittest.TestCase):
    """The repository as it is."""

    @classmethod
    def setUpClass(cls):
        cls.known = set(tree.tracked())
        cls.files = texts()

    def none(self, sentences):
        """Fails with all of them."""
        sentences = list(sentences)
        self.assertEqual([], sentences, '\n' + '\n'.join(sentences))

    def test_columns(self):
        self.assertGreater(len(self.files), 400)
        self.none(long_lines(self.files))

    def test_citations(self):
        self.none(far_citations(self.files))

    def test_maps(self):
        self.none(long_maps(self.files))

    def test_names(self):
        # The names of tests/tree are made up. Notes are of their day: what they name may be elsewhere since.
        own = {path: text for path, text in self.files.items()
               if not path.startswith('tests/tree/') and os.path.basename(path) != 'NOTES.md'}
        self.none(lost_names(own, self.known))

    def test_quotes(self):
        """What git is quoted with is what it says, unless the repository is here without its history."""
        quotes = QUOTED.findall(tree.read('CONTRIBUTING.md'))
        self.assertNotEqual([], quotes)
        for command, quoted in quotes:
            words = ['git', '-C', tree.ROOT, *shlex.split(command)[1:]]
            if subprocess.run([*words[:3], 'cat-file', '-e', words[-1]], capture_output=True).returncode != 0:
                self.skipTest(f'{words[-1]} is not here')
            said = subprocess.run(words, check=True, capture_output=True, text=True).stdout
            self.assertEqual(said.rstrip(), textwrap.dedent(quoted).rstrip(), command)

    def test_sources(self):
        self.none(lost_sources(self.files, self.known))

    def test_comments(self):
        self.none(vague_comments(self.files))


class Checks(unittest.TestCase):
    """The checks themselves."""

    def test_comments(self):
        cases = {'/* Of each tile: its first point. */': 1, '// What a ray met': 1, '/* Office of a tile. */': 0,
                 '/* First point of each tile. That of the last one ends it. */': 0, '/* How many there are */': 1}
        for text, count in cases.items():
            self.assertEqual(count, len(list(vague_comments({'a.h': text}))), text)

    def test_columns(self):
        line = 'x' * (COLUMNS + 1)
        self.assertEqual(1, len(list(long_lines({'a.c': f'{line[1:]}\n{line}\n'}))))
        self.assertEqual(0, len(list(long_lines({'a.md': f'| {line} |\nhttps://{line}\n'}))))
        self.assertEqual(1, len(list(long_lines({'a.md': line}))))

    def test_maps(self):
        short, long = 'a\n' * (MAP_LINES - 1), 'a\n' * MAP_LINES
        self.assertEqual(0, len(list(long_maps({'a/README.md': short, 'README.md': long, 'a/NOTES.md': long}))))
        self.assertEqual(1, len(list(long_maps({'a/README.md': long}))))

    def test_citations(self):
        cases = {'/* Estimators (DES' 'IGN section 3) */': 1, '/* see PERF' 'ORMANCE.md */': 1, '/* by design */': 0,
                 '/* README.md section 3 */': 0}
        for line, count in cases.items():
            self.assertEqual(count, len(list(far_citations({'a.c': line}))), line)

    def test_names(self):
        known = {'coordinator/a.h', 'tests/README.md', 'tests/unit/b.c'}
        cases = {'coordinator/a.h': 0, 'coordinator/b.h': 1, 'README.md': 0, 'TODO.md': 1, '<mpi.h>': 0,
                 '     coordinator/b.h  |  3 +++': 0, '| coordinator/b.h | 3 |': 1}
        for line, count in cases.items():
            self.assertEqual(count, len(list(lost_names({'tests/x.py': line}, known))), line)

        known = {'coordinator/a.h', 'coordinator/work.h'}
        for line, count in {'/* see work.h */': 0, '/* see\n(play.h) */': 1, 'x = play.h;': 0, '// play.c': 1}.items():
            self.assertEqual(count, len(list(lost_sources({'worker/x.c': line}, known))), line)


if __name__ == '__main__':
    unittest.main()
