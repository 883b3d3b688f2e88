"""Who may include whom. The table of rooms in the README.md of coordinator/, worker/ and shaders/ says it; the sources
and, where kiln has been built, the symbols of the object files are held against it. In a table a room may include only
rooms above its own row, so there is no circle, of includes or of calls."""
import os
import unittest

import tree


def above(rooms):
    """The rooms whose rows stand above each room's row, in its own table."""
    seen = []
    result = {}
    for room in rooms:
        result[room] = {other for other in seen if other.split('/')[0] == room.split('/')[0]}
        seen.append(room)
    return result


def allowed(rooms, source, target):
    """Whether the file `source` may take from the room `target`."""
    room = tree.room_of(source, rooms)
    if target == room or room not in rooms:
        return target == room
    row = rooms[room]
    if target.split('/')[0] != room.split('/')[0]:
        # Only worker/backend itself knows the folders of single back ends.
        return target.split('/')[0] in tree.TOPS[room.split('/')[0]] and not target.startswith('worker/backend/')
    return target in row.includes or row.every and target in above(rooms)[room] or \
        target in row.registers.get(source, ())


def wrong_rows(rooms):
    """Arrows of the tables that do not point upwards, or to no room."""
    for room, row in rooms.items():
        for target in sorted(row.includes - above(rooms)[room]):
            yield f'{room}: the table lets it include {target}, whose row is not above its own'
        for file, targets in row.registers.items():
            for target in sorted(targets - set(rooms)):
                yield f'{file}: the table lets it register {target}, which has no row'


def wrong_includes(rooms, sources):
    """Sentences on the includes that the tables do not allow, and on folders without a row."""
    for room in sorted({tree.room_of(path, rooms) for path in sources} - set(rooms)):
        yield f'{room}: it has no row in the table of {room.split("/")[0]}/README.md'
    for path, line, name in tree.includes(sources):
        target = tree.room_of(name, rooms)
        if not allowed(rooms, path, target):
            yield f'{path}:{line}: {tree.room_of(path, rooms)} may not include {name} (see README.md)'


def idle_arrows(rooms, sources):
    """Arrows of the tables that no include needs."""
    used = {(tree.room_of(path, rooms), tree.room_of(name, rooms)) for path, _, name in tree.includes(sources)}
    for room, row in rooms.items():
        for target in sorted(row.includes):
            if (room, target) not in used:
                yield f'{room}: the table lets it include {target}, and nothing in it does: take that out'


def wrong_calls(rooms, defined, needed):
    """Sentences on symbols that are taken from rooms from which the tables do not allow to take any."""
    for source, name in needed:
        target = tree.room_of(defined[name] if name in defined else source, rooms)
        if not allowed(rooms, source, target):
            yield f'{source}: it uses {name} of {defined[name]}, and may not include {target}'


class Rooms(unittest.TestCase):
    """The repository as it is."""

    @classmethod
    def setUpClass(cls):
        cls.rooms = tree.table()
        cls.sources = {path: tree.read(path) for path in tree.tracked()
                       if path.split('/')[0] in tree.TOPS and tree.SOURCES.search(path)}

    def none(self, sentences):
        """Fails with all of them."""
        sentences = list(sentences)
        self.assertEqual([], sentences, '\n' + '\n'.join(sentences))

    def test_tables(self):
        self.assertGreater(len(self.rooms), 20)
        self.none(wrong_rows(self.rooms))
        there = {tree.room_of(path, self.rooms) for path in self.sources}
        self.none(f'{room}: it has a row in a table and no source' for room in self.rooms if room not in there)
        self.none(f'{file}: a row of a table names it, and it is not there' for row in self.rooms.values()
                  for file in sorted(row.files) if file not in self.sources)

    def test_includes(self):
        self.assertGreater(len(list(tree.includes(self.sources))), 500)
        self.none(wrong_includes(self.rooms, self.sources))

    def test_idle_arrows(self):
        self.none(idle_arrows(self.rooms, self.sources))

    def test_calls(self):
        folder = os.path.dirname(os.environ.get('KILN', ''))
        defined, needed = tree.read_symbols(folder)
        if not needed:
            self.skipTest(f"there are no object files of kiln in '{folder}'")
        self.none(sorted(set(wrong_calls(self.rooms, defined, needed))))


class Checks(unittest.TestCase):
    """The checks themselves, on a small house."""
    TABLE = '''
| room | what | may include |
| --- | --- | --- |
| `mpi/` | a | |
| `backend/one/` | b | `mpi` |
| `plain.h` `bare.h` | bb | |
| `backend/` | c | `mpi`; `table.c` registers `one/` |
| `cli/` | d | every room above |
'''

    def setUp(self):
        self.rooms = tree.parse_table('worker', self.TABLE)

    def found(self, path, name):
        """Whether an include is refused."""
        return len(list(wrong_includes(self.rooms, {path: f'\n#include "{name}"\n'}))) == 1

    def test_arrows(self):
        self.assertFalse(self.found('worker/cli/a.c', 'worker/mpi/b.h'))
        self.assertFalse(self.found('worker/cli/a.c', 'worker/cli/b.h'))
        self.assertFalse(self.found('worker/mpi/a.c', 'shaders/b.h'))
        self.assertFalse(self.found('worker/backend/table.c', 'worker/backend/one/b.h'))
        self.assertTrue(self.found('worker/backend/other.c', 'worker/backend/one/b.h'))
        self.assertFalse(self.found('worker/bare.h', 'worker/plain.h'))
        self.assertTrue(self.found('worker/mpi/a.c', 'worker/plain.h'))
        self.assertTrue(self.found('worker/mpi/a.c', 'worker/cli/b.h'))
        self.assertTrue(self.found('worker/mpi/a.c', 'coordinator/mpi/b.h'))
        self.assertTrue(self.found('worker/hall/a.c', 'stdio.h'))

    def test_rows(self):
        self.assertEqual([], list(wrong_rows(self.rooms)))
        turned = tree.parse_table('worker', self.TABLE.replace('| a | |', '| a | `cli` |'))
        self.assertEqual(1, len(list(wrong_rows(turned))))
        self.assertEqual(2, len(list(idle_arrows(self.rooms, {}))))

    def test_calls(self):
        defined = {'f': 'worker/cli/a.c', 'g': 'worker/mpi/b.c'}
        self.assertEqual([], list(wrong_calls(self.rooms, defined, [('worker/cli/a.c', 'g'), ('worker/cli/a.c', 'h')])))
        self.assertEqual(1, len(list(wrong_calls(self.rooms, defined, [('worker/mpi/b.c', 'f')]))))


if __name__ == '__main__':
    unittest.main()
