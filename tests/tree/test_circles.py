"""Circles of files, in the linker's symbols: files each of which needs a function or an object of the next, and the
last of the first. A reader of one has to know all. Includes are no measure: a header may be taken for its types."""
import os
import unittest

import tree

MOST = 5  # files in a circle

# Rooms whose largest circle has more. None may grow, and a row goes when its circle has come down to MOST.
EXCEPTIONS = {}


def links_of(defined, needed):
    """{file: the files whose symbols it uses}."""
    links = {source: set() for source in defined.values()}
    for source, name in needed:
        if defined.get(name, source) != source:
            links.setdefault(source, set()).add(defined[name])
    return links


def circles(links):
    """The strongly connected components of more than one file, the largest first (Tarjan, "Depth-first search and
    linear graph algorithms", SIAM Journal on Computing 1972)."""
    number, lowest, open_files, found = {}, {}, [], []

    def enter(file):
        number[file] = lowest[file] = len(number)
        open_files.append(file)
        return file, iter(sorted(links[file]))

    def leave(file):
        if lowest[file] == number[file]:
            begin = open_files.index(file)
            if len(open_files) - begin > 1:
                found.append(sorted(open_files[begin:]))
            del open_files[begin:]

    for root in links:
        walk = [enter(root)] if root not in number else []
        while walk:
            file, rest = walk[-1]
            other = next(rest, None)
            if other is None:
                leave(file)
                walk.pop()
                if walk:
                    lowest[walk[-1][0]] = min(lowest[walk[-1][0]], lowest[file])
            elif other not in number:
                walk.append(enter(other))
            elif other in open_files:
                lowest[file] = min(lowest[file], number[other])
    return sorted(found, key=lambda circle: (-len(circle), circle))


def wrong_circles(found, exceptions):
    """Sentences on circles that are too large, and on exceptions that nothing needs."""
    largest = {}
    for circle in found:
        room = os.path.commonpath([os.path.dirname(file) for file in circle])
        largest[room] = max(largest.get(room, 0), len(circle))
        if len(circle) > exceptions.get(room, MOST):
            yield f'{room}: {len(circle)} files are one circle, and at most {exceptions.get(room, MOST)} may be: ' \
                  f'{" ".join(os.path.basename(file) for file in circle)}: keep what lists them all apart from what ' \
                  'all of them use'
    for room in sorted(exceptions):
        if largest.get(room, 0) <= MOST:
            yield f'{room}: its largest circle has {largest.get(room, 0)} files: take its row out of EXCEPTIONS'


class Circles(unittest.TestCase):
    """The program as it was built."""

    def test_circles(self):
        folder = os.path.dirname(os.environ.get('KILN', ''))
        defined, needed = tree.read_symbols(folder)
        if not needed:
            self.skipTest(f"there are no object files of kiln in '{folder}'")
        links = links_of(defined, needed)
        self.assertGreater(sum(map(len, links.values())), 1000)
        self.assertLessEqual({file.split('/')[0] for file in links}, set(tree.TOPS))
        sentences = list(wrong_circles(circles(links), EXCEPTIONS))
        self.assertEqual([], sentences, '\n' + '\n'.join(sentences))


class Checks(unittest.TestCase):
    """The checks themselves, on a few files."""

    def test_links(self):
        links = links_of({'f': 'a.c', 'g': 'b.c'}, [('a.c', 'g'), ('a.c', 'f'), ('c.c', 'f'), ('c.c', 'malloc')])
        self.assertEqual({'a.c': {'b.c'}, 'b.c': set(), 'c.c': {'a.c'}}, links)

    def test_circles(self):
        links = {'a': {'b'}, 'b': {'c', 'd'}, 'c': {'a'}, 'd': {'e'}, 'e': {'f'}, 'f': {'e'}, 'g': {'a', 'f'}}
        self.assertEqual([['a', 'b', 'c'], ['e', 'f']], circles(links))

    def test_sentences(self):
        seven = [f'top/room/{i}.c' for i in range(7)]
        self.assertEqual(1, len(list(wrong_circles([seven], {}))))
        self.assertEqual([], list(wrong_circles([seven[:MOST]], {})))
        self.assertEqual([], list(wrong_circles([seven], {'top/room': 7})))
        self.assertEqual(1, len(list(wrong_circles([seven], {'top/room': 6}))))
        self.assertEqual(1, len(list(wrong_circles([seven[:MOST]], {'top/room': 7}))))


if __name__ == '__main__':
    unittest.main()
