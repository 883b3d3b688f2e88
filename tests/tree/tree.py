"""The files of the repository, and the tables of rooms in its README.md files. Used by the tests beside it."""
import collections
import os
import re
import subprocess

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

# The folders of sources, from the top down, and those that each may include besides itself.
TOPS = {'coordinator': {'worker'}, 'worker': {'shaders'}, 'shaders': set()}
SOURCES = re.compile(r'\.(c|h|cpp|hpp|comp|glsl|rahit|rchit|rmiss)$')
INCLUDE = re.compile(r'\s*#\s*include\s+"([^"]+)"')

# What a README's table says of a room: the rooms it may include, and for each of its files that registers variants
# (a table of back ends, of integrators) the rooms of these. `every` stands for all rooms above it in the table.
# `files` are those of a row that names files of a folder instead of the folder.
Room = collections.namedtuple('Room', 'includes registers every files')


def tracked():
    """Paths of all files in the working tree that git tracks or would track, relative to ROOT."""
    listing = subprocess.run(['git', '-C', ROOT, 'ls-files', '--cached', '--others', '--exclude-standard', '-z'],
                             check=True, capture_output=True).stdout.decode()
    return sorted(path for path in set(listing.split('\0')) if path and os.path.isfile(os.path.join(ROOT, path)))


def read(path):
    """The text of a tracked file."""
    with open(os.path.join(ROOT, path), encoding='utf-8', errors='replace') as file:
        return file.read()


def room_of(path, rooms):
    """The room of a file: the row that names it, else its folder."""
    for room, row in rooms.items():
        if path in row.files:
            return room
    return os.path.dirname(path)


def parse_table(top, text):
    """{room: Room} in the order of the table of README.md whose last column is headed `may include`.

    The first cell names the room: `mpi/`, or `.` for the files in the top folder itself, or some files of a folder, the
    first of which names the room. The last cell holds names of rooms of the same folder, "every room above", and
    "`FILE` registers `ROOM` ..."."""
    rooms = {}
    inside = False
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip().strip('|').split('|')] if line.startswith('|') else []
        if not cells:
            inside = False
        elif cells[-1] == 'may include':
            inside = True
        elif inside and not set(cells[0]) <= set('-: '):
            name, *more = [n.rstrip('/') for n in re.findall(r'`([^`]*)`', cells[0])]
            files = {f'{top}/{n}' for n in (name, *more) if SOURCES.search(n)}
            plain, *clauses = cells[-1].split(';')
            names = re.findall(r'`([^`]*)`', plain)
            registers = {}
            for clause in clauses:
                file, *variants = re.findall(r'`([^`]*)`', clause)
                registers[f'{top}/{name}/{file}'] = {f'{top}/{name}/{n.rstrip("/")}' for n in variants}
            rooms[top if name == '.' else f'{top}/{name}'] = Room(
                {f'{top}/{n.rstrip("/")}' for n in names},
                registers, 'every room above' in plain, files)
    return rooms


def table():
    """The tables of all top folders together."""
    rooms = {}
    for top in TOPS:
        rooms.update(parse_table(top, read(f'{top}/README.md')))
    return rooms


def includes(sources):
    """(file, line, included path) of every #include "..." in {path: text}. A name without folder is beside the file."""
    for path, text in sources.items():
        for number, line in enumerate(text.splitlines(), 1):
            match = INCLUDE.match(line)
            if match:
                name = match.group(1)
                yield path, number, name if '/' in name else f'{os.path.dirname(path)}/{name}'


def read_symbols(folder):
    """({symbol: source that defines it}, [(source, symbol it needs)]) of the object files of a build folder."""
    objects = {}
    for library in ('kiln_worker.dir', 'kiln_coordinator.dir', 'kiln.dir'):
        for place, _, names in os.walk(os.path.join(folder, 'CMakeFiles', library)):
            for name in names:
                path = os.path.join(place, name)
                source = os.path.relpath(path, os.path.join(folder, 'CMakeFiles', library))[:-len('.o')]
                if name.endswith('.o') and os.path.exists(os.path.join(ROOT, source)):
                    objects[path] = source
    defined, needed = {}, []
    if not objects:
        return defined, needed
    listing = subprocess.run(['nm', '-A', '--format=posix', *objects], check=True, capture_output=True, text=True)
    for line in listing.stdout.splitlines():
        path, rest = line.split(': ', 1)
        name, kind = rest.split()[:2]
        if kind in 'TDBRV':
            defined[name] = objects[path]
        elif kind == 'U':
            needed.append((objects[path], name))
    return defined, needed
