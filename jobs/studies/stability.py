"""kiln bench stability: what must hold where numbers get extreme, held against closed forms

Does light stay right where a scene is tiny, huge, thin or coincident? Each row of the table makes a small scene, bakes
it in a process of its own, and compares with a closed form, or with another bake that must be the same. The words are
names of rows; without any all run but those that want to be named. A row that does not hold is an error (exit code 70).

The standard scene is a closed box of 2 m whose inner walls emit L and reflect rho, so that E = pi L / (1 - rho) on
them, and above it a black floor of 2 m under a lamp that faces it. Of the lamp, a polygon with corners r_i as seen from
a point of the floor, E = L/2 |sum over edges of angle(r_i, r_i+1) n . (r_i x r_i+1) / |r_i x r_i+1|| (Lambert,
"Photometria", 1760). There is no figure: the table is printed.

Price: a minute or two; `largest-map`, which is tried by its name only, many minutes and more than 5 GB."""
import json
import math
import os
import sys
import tempfile
import time

import numpy as np

from study import child, exr, glb, options
from study.child import Failure

ALWAYS = ['--no-preview', '--no-resume', '--samples-probe', 0, '--denoise', 'none', '--lightmap-size', 16,
          '--samples-direct', 2048]
WALLS, FLOOR = range(6), 6  # objects of the standard scene; without the box the floor is object 0
FACES = ((4, 6, 7, 5), (1, 3, 2, 0), (5, 7, 3, 1), (0, 2, 6, 4), (6, 2, 3, 7), (0, 4, 5, 1))  # bits: x 1, y 2, z 4
FLOOR_CORNERS = np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], float)
UP = np.array([0.0, 1.0, 0.0])
FULL = ((0, 1), (1, 1), (1, 0), (0, 0))


class Refused(Exception):
    """A bake that failed: what was found."""


# ---- closed forms ----

def lambert(corners, places, normal):
    """E/L at places (n, 3) of a polygon."""
    total = np.zeros(len(places))
    for a, b in zip(corners, np.roll(corners, -1, 0)):
        a, b = a - places, b - places
        edge = np.cross(a, b)
        length = np.linalg.norm(edge, axis=1)
        angle = np.arctan2(length, (a * b).sum(1))
        total += np.where(length > 0, angle * (edge @ normal) / np.where(length > 0, length, 1), 0)
    return 0.5 * np.abs(total)


def lambert_over(corners, middles, sides, normal):
    """The mean over texels with these middles and this pair of sides."""
    cuts = (np.arange(4) + 0.5) / 4 - 0.5
    return sum(lambert(corners, middles + u * sides[0] + v * sides[1], normal) for u in cuts for v in cuts) / 16


def lamp_corners(half_x, half_z, height):
    return np.array([(-half_x, height, -half_z), (half_x, height, -half_z), (half_x, height, half_z),
                     (-half_x, height, half_z)], float)


# ---- a trial ----

class Points:
    """The surface points of a bake, by object, row and column."""

    def __init__(self, path):
        import h5py
        with h5py.File(path, 'r') as file:
            get = lambda name: file[name][...]
            self.object, texel = get('points/object'), get('points/texel').reshape(-1, 2)
            order = np.lexsort((texel[:, 0], texel[:, 1], self.object))
            self.object, self.texel = self.object[order], texel[order]
            self.position, self.area = get('points/position')[order], get('points/area').astype(float)[order]
            self.valid = get('points/valid').astype(bool)[order]
            self.direct = get('irradiance/direct').astype(float)[order]
            self.indirect = get('irradiance/indirect').astype(float)[order]

    def mean(self, index):
        """All light, green, over an object by area."""
        here = (self.object == index) & self.valid
        area = self.area[here].sum()
        light = (self.direct + self.indirect)[here, 1]
        return float((self.area[here] * light).sum() / area) if area > 0 else 0.0

    def walls_error(self, want):
        """The largest relative error of the means of the six walls."""
        off = [abs(self.mean(i) / want - 1) for i in WALLS]
        return max(o if math.isfinite(o) else 1e9 for o in off)


class Trial:
    """A small scene in a temporary folder, and its bake: run.json, surface points, what was written to stderr."""

    def __init__(self, scratch, given):
        self.scratch, self.given, self.quads = scratch, given, 0
        self.scene = glb.Scene()
        self.result = os.path.join(scratch, 'bake')

    def material(self, albedo, radiance=0.0):
        return self.scene.material('material', (np.float32(albedo),) * 3, (np.float32(radiance),) * 3)

    def mesh(self, positions, layout, triangles, material, **transform):
        self.scene.mesh('object%d' % self.quads, positions, layout, triangles, material, **transform)
        self.scene.document['meshes'][-1]['primitives'][0]['attributes'].pop('NORMAL')
        self.quads += 1

    def quad(self, corners, material, cut=0, **transform):
        """A parallelogram, cut from corner `cut` to the opposite one; its lightmap is full."""
        self.mesh(corners, FULL, [(1, 2, 3), (1, 3, 0)] if cut else [(0, 1, 2), (0, 2, 3)], material, **transform)

    def box(self, low, high, material, scale=1.0, **transform):
        """Fronts inside, one object a wall."""
        ends = np.array([low, high], float)
        for face in FACES:
            corners = np.array([[ends[bits >> axis & 1, axis] for axis in range(3)] for bits in face])
            self.quad(corners * scale, material, **transform)

    def bake_any(self, *words):
        child.remove(self.result)
        path = self.scene.write(os.path.join(self.scratch, 'scene.glb'))
        self.done = child.kiln('bake', path, '-o', self.result, *ALWAYS, *words, *self.given.words('bake'))
        return self.done.code

    def bake(self, *words):
        """The points; Refused if the bake fails."""
        if self.bake_any(*words) != 0:
            raise Refused('exit code %d: %.120s' % (self.done.code, self.done.sentence().split('\n')[0]))
        self.report = child.report(self.result)
        return Points(os.path.join(self.result, 'kiln.h5'))

    def says(self, words):
        """Whether stderr or a note in run.json has these words."""
        return any(words in text for text in [self.done.said, *getattr(self, 'report', {}).get('notes', [])])


# ---- the standard scene ----

class Setup:
    """How the standard scene is changed: by the vertices, by the nodes (a 3 x 3 matrix, a shift in m), by its light."""

    def __init__(self, scale=1.0, linear=None, shift=(0, 0, 0), radiance=1.0, lamp=1.0, height=1.0, open=False,
                 words=()):
        self.scale, self.linear, self.shift = scale, linear, np.array(shift, float)
        self.radiance, self.open, self.words = radiance, open, words
        self.lamp = lamp_corners(lamp / 2, lamp / 2, height)

    def transform(self):
        if self.linear is None:
            return {'translation': list(self.shift)} if self.shift.any() else {}
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.linear, self.shift
        return {'matrix': matrix.T.ravel().tolist()}

    def placed(self, corners):
        """In the world, but for the shift."""
        return corners * self.scale @ (np.eye(3) if self.linear is None else np.array(self.linear, float)).T

    def make(self, trial):
        where = self.transform()
        if not self.open:
            trial.box((-1, -3, -1), (1, -1, 1), trial.material(0.5, self.radiance), self.scale, **where)
        trial.quad(FLOOR_CORNERS * self.scale, trial.material(0), **where)
        trial.quad(self.lamp * self.scale, trial.material(0, self.radiance), **where)

    def floor_error(self, points, index, texels=16, lamp=None):
        """Root of the mean square of the relative error of the floor's direct light; 1e9 where there is none."""
        floor, at = self.placed(FLOOR_CORNERS), self.placed(self.lamp if lamp is None else lamp)
        sides = np.array([floor[1] - floor[0], floor[3] - floor[0]]) / texels
        across = np.cross(*sides)
        here = points.object == index
        want = lambert_over(at, points.position[here] - self.shift, sides, across / np.linalg.norm(across))
        off = points.direct[here, 1] / self.radiance / want - 1
        total = float((off * off).sum())
        return math.sqrt(total / len(off)) if len(off) and math.isfinite(total) else 1e9


def standard(trial, row, setup):
    setup.make(trial)
    points = trial.bake(*setup.words)
    floor = setup.floor_error(points, 0 if setup.open else FLOOR)
    if setup.open:
        return floor <= row.tolerance, 'floor off by %.3g %%' % (100 * floor)
    walls = points.walls_error(2 * math.pi * setup.radiance)
    return max(floor, walls) <= row.tolerance, 'floor off by %.3g %%, furnace by %.3g %%' % (100 * floor, 100 * walls)


def of(make):
    """A row of the standard scene, changed as make(x) says."""
    return lambda trial, row: standard(trial, row, make(row.x))


SCALE = of(lambda x: Setup(scale=x))
SCALE_NODE = of(lambda x: Setup(linear=np.eye(3) * x))
TRANSLATION = of(lambda x: Setup(shift=(x, -x, 0.5 * x)))
SHEAR = of(lambda x: Setup(linear=[(1, x, 0), (0, 1, 0), (0, 0.3 * x, 1)],
                           words=('--samples-direct', 16384)))  # its light grazes the floor
MIRROR = of(lambda x: Setup(linear=np.diag([x, 1, 1])))
RADIANCE = of(lambda x: Setup(radiance=x))
LAMP = of(lambda x: Setup(lamp=x, open=True))
DISTANCE = of(lambda x: Setup(lamp=4, height=x, open=True))


# ---- furnaces ----

def furnace(trial, row, albedo=0.5, height=2.0, words=(), text="a wall's mean off by %.3g %%"):
    trial.box((-1, -height / 2, -1), (1, height / 2, 1), trial.material(albedo, 1))
    walls = trial.bake(*words).walls_error(math.pi / (1 - albedo))
    return walls <= row.tolerance, text % (100 * walls)


def few_samples(trial, row):
    return furnace(trial, row, words=('--samples-direct', 1, '--samples-bounce', 1, '--samples-indirect', 1,
                                      '--lightmap-size', 64))


def many_samples(trial, row):
    return furnace(trial, row, words=('--samples-direct', 1000000, '--samples-indirect', 1000000, '--lightmap-size', 1),
                   text='a wall off by %.3g %%')


def run_furnace(trial, row):
    if row.x < 1:
        return furnace(trial, row, row.x)
    trial.box((-1, -1, -1), (1, 1, 1), trial.material(1, 1))
    trial.bake()
    said = trial.report['tail']['diverges'] and trial.says('diverge')
    return said, 'tail.diverges, and a note' if said else 'not said, or only in one place'


def coincident(trial, row):
    """Two sheets that face away from one another divide a furnace. x: 0 and 1 are the two orders; 2 and 3 the same with
    other diagonals."""
    sheets = np.array([[(0, -1, 1), (0, -1, -1), (0, 1, -1), (0, 1, 1)],
                       [(0, -1, -1), (0, -1, 1), (0, 1, 1), (0, 1, -1)]], float)
    wall, towards = trial.material(0.5, 1), row.x % 2
    trial.box((-1, -1, -1), (1, 1, 1), wall)
    trial.quad(sheets[towards], wall)
    trial.quad(sheets[1 - towards], wall, cut=row.x < 2)
    points = trial.bake()
    off = max(abs(points.mean(i) / (2 * math.pi) - 1) for i in range(8))
    energy = trial.report['energy']
    blocked = energy['blocked'][1] / energy['emitted'][1]
    return off <= row.tolerance and blocked <= 1e-6, 'an object off by %.3g %%, %.2g of the light is lost' % (
        100 * off, blocked)


# ---- maps, and what must be the same ----

def one_texel(trial, row):
    setup = Setup()
    setup.make(trial)
    points = trial.bake('--lightmap-size', 1, '--samples-direct', 4096)
    axis = (np.arange(64) + 0.5) * 2 / 64 - 1
    places = np.stack([*np.meshgrid(axis, [0.0], axis, indexing='ij')], -1).reshape(-1, 3)
    floor = abs(points.mean(FLOOR) / float(lambert(setup.lamp, places, UP).mean()) - 1)
    walls = points.walls_error(2 * math.pi)
    return max(floor, walls) <= row.tolerance, 'floor off by %.3g %%, furnace by %.3g %%' % (100 * floor, 100 * walls)


def largest_map(trial, row):
    """A floor of 16384 x 16384 texels, whose halves cover two opposite corners of its layout, 1/64 of its sides
    each."""
    setup, high = Setup(open=True), 1 / 64
    corners = [(-1, 0, 1), (0, 0, 1), (0, 0, -1), (-1, 0, -1), (0, 0, 1), (1, 0, 1), (1, 0, -1), (0, 0, -1)]
    layout = [(0, high), (high, high), (high, 0), (0, 0), (1 - high, 1), (1, 1), (1, 1 - high), (1 - high, 1 - high)]
    trial.mesh(corners, layout, [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)], trial.material(0))
    trial.quad(setup.lamp, trial.material(0, 1))
    points = trial.bake('--lightmap-size', 16384, '--lightmap-max', 16384, '--objects',
                        '{object1: {lightmap-size: 16}}')
    off = setup.floor_error(points, 0, 256)
    return off <= row.tolerance, 'floor off by %.3g %%' % (100 * off)


def half_floats(trial, row):
    Setup(radiance=row.x).make(trial)
    points = trial.bake('--half')
    channels, _ = exr.read(os.path.join(trial.result, 'lightmaps', 'object0.exr'))
    off = float(channels['G'].mean(dtype=float)) / points.mean(0) - 1
    return abs(off) <= row.tolerance, "a wall's map off by %.3g %%" % (100 * off)


def cells(trial, row):
    Setup().make(trial)
    a = trial.bake()
    b = trial.bake('--cell-size', '%g' % row.x)
    worst = 1e9
    if len(a.object) == len(b.object) and (a.object == b.object).all() and (a.texel == b.texel).all():
        worst = float((abs(a.direct - b.direct) + abs(a.indirect - b.indirect)).max())
    return worst <= row.tolerance, 'E differs by %.3g W/m2 at most' % worst


# ---- triangles ----

def slivers(trial, row):
    """A floor whose middle is two triangles 2 m long and 2 m / x wide."""
    setup = Setup(open=True)
    corners = np.array([(x, 0, z) for z in (1, 1 / row.x, -1 / row.x, -1) for x in (-1, 1)], np.float32)
    layout = [((x + 1) / 2, np.float32(0.5) + np.float32(0.5) * z) for x, _, z in corners]
    triangles = [t for a in (0, 2, 4) for t in ((a, a + 1, a + 3), (a, a + 3, a + 2))]
    trial.mesh(corners, layout, triangles, trial.material(0))
    trial.quad(setup.lamp, trial.material(0, 1))
    off = setup.floor_error(trial.bake(), 0)
    return off <= row.tolerance, 'floor off by %.3g %%' % (100 * off)


def flat_furnace(trial, row):
    return furnace(trial, row, height=row.x)


def not_a_number(trial, row):
    corners = FLOOR_CORNERS.copy()
    corners[2, 1] = math.nan
    trial.quad(corners, trial.material(0.5, 1))
    code = trial.bake_any()
    said = trial.says('error: ') and trial.says('vertex 2')
    return code == child.BAD_INPUT and said, 'exit code %d, %s' % (
        code, 'and a sentence that names the vertex' if said else 'no sentence')


def doubled(trial, row):
    """Two floors in one place that face the same way, under a lamp."""
    setup, black = Setup(open=True), trial.material(0)
    trial.quad(FLOOR_CORNERS, black)
    trial.quad(FLOOR_CORNERS, black, cut=row.x)
    trial.quad(setup.lamp, trial.material(0, 1))
    points = trial.bake()
    off = max(setup.floor_error(points, index) for index in (0, 1))
    said = trial.says("'object0' and 'object1'")
    return off <= row.tolerance and said, 'a floor off by %.3g %%%s' % (
        100 * off, '; a note names both' if said else ', nothing is said')


# ---- lights ----

def strip(trial, row):
    setup, lamp = Setup(open=True), lamp_corners(row.x / 2, 50, 1)
    lamp[:, 0] = (lamp[:, 0] + 0.1).astype(np.float32)
    trial.quad(FLOOR_CORNERS, trial.material(0))
    trial.quad(lamp, trial.material(0, 1))
    off = setup.floor_error(trial.bake('--samples-direct', 256, '--lightmap-size', 24), 0, 24, lamp)
    return off <= row.tolerance, 'floor off by %.3g %%' % (100 * off)


def point(trial, row):
    """A point light over the middle of the floor, x m high: the floor takes I times the solid angle in which it is
    seen, 4 atan(a2 / (h sqrt(2 a2 + h2))) of a square of half side a."""
    h = row.x
    angle, intensity = 4 * math.atan(1 / (h * math.sqrt(2 + h * h))), 1 + h * h
    trial.quad(FLOOR_CORNERS, trial.material(0))
    trial.scene.light('light', {'type': 'point', 'color': [1, 1, 1], 'intensity': intensity},
                      translation=[0.01, h, 0.02])
    off = trial.bake().mean(0) * 4 / (intensity * angle) - 1
    said = trial.says("'object0' has a point or spot light")
    return abs(off) <= row.tolerance or said, ('off by %+.3g %%; a note names the object' if said else
                                               'all light off by %+.3g %%') % (100 * off)


# ---- the table ----

class Row:
    def __init__(self, group, tried, expected, x, tolerance, run, by_name_only=False):
        self.group, self.tried, self.expected, self.x, self.tolerance = group, tried, expected, x, tolerance
        self.run, self.by_name_only = run, by_name_only


SAME_FORM, FLOOR_FORM = 'closed forms of floor and furnace, within 1 %', 'closed form at each texel, within 1 % rms'
FURNACE_FORM, STRIP_FORM = 'E = pi L / (1 - albedo), within 0.3 %', 'closed form, within 0.3 % rms'
SHEETS = 'E within 0.3 %, none lost'
ROWS = [
    *[Row('scale', 'vertices ' + tried, SAME_FORM, x, 0.01, SCALE) for tried, x in (
        ('times 1e-8', 1e-8), ('times 1e-4', 1e-4), ('as they are', 1.0), ('times 1e5', 1e5), ('times 1e10', 1e10))],
    *[Row('scale', "nodes' scale " + tried, SAME_FORM, x, 0.01, SCALE_NODE) for tried, x in (
        ('1e-8', 1e-8), ('1e10', 1e10))],
    *[Row('translation', tried + ' m by the nodes', SAME_FORM, x, 0.01, TRANSLATION) for tried, x in (
        ('1e5', 1e5), ('1e11', 1e11))],
    Row('shear', 'by 1 and 0.3', SAME_FORM, 1.0, 0.01, SHEAR),
    Row('shear', 'by 3 and 0.9', SAME_FORM, 3.0, 0.01, SHEAR),
    Row('mirror', 'x times -1 by the nodes', SAME_FORM, -1.0, 0.01, MIRROR),
    Row('mirror', 'x times -3 by the nodes', SAME_FORM, -3.0, 0.01, MIRROR),
    *[Row('radiance', tried + ' W/(m2 sr)', SAME_FORM, x, 0.01, RADIANCE) for tried, x in (
        ('1e-30', 1e-30), ('1e-10', 1e-10), ('1e15', 1e15))],
    *[Row('lamps', tried + ' m wide, 1 m away', FLOOR_FORM, x, 0.01, LAMP) for tried, x in (
        ('1e-7', 1e-7), ('1e-3', 1e-3), ('1e3', 1e3), ('1e6', 1e6))],
    *[Row('distances', 'a lamp of 4 m, %s m away' % tried, FLOOR_FORM, x, 0.01, DISTANCE) for tried, x in (
        ('1e-6', 1e-6), ('1e-3', 1e-3), ('1e6', 1e6))],
    Row('distances', 'a point light 1e6 m away', 'all light within 1 %', 1e6, 0.01, point),
    Row('near-light', 'a point light 1 m above a floor', 'all light within 1 %', 1.0, 0.01, point),
    Row('near-light', 'a point light 1 cm above a texel', 'all light within 1 %, or a note', 1e-2, 0.01, point),
    Row('near-light', 'a point light 1 mm above a texel', 'all light within 1 %, or a note', 1e-3, 0.01, point),
    *[Row('thin-lamps', tried + ' x 100 m, 256 samples', STRIP_FORM, x, 0.003, strip) for tried, x in (
        ('5 cm', 0.05), ('2 cm', 0.02), ('0.1 mm', 1e-4))],
    Row('slivers', 'a floor with triangles 1e4 times as long as wide', FLOOR_FORM, 1e4, 0.01, slivers),
    Row('slivers', 'a floor with triangles 1e8 times as long as wide', FLOOR_FORM, 1e8, 0.01, slivers),
    Row('slivers', 'a furnace of 2 x 2 m, 0.1 mm high', 'E = pi L / (1 - albedo), within 1 %', 1e-4, 0.01,
        flat_furnace),
    Row('not-a-number', 'NaN as a coordinate', 'refused, exit code 65', 0, 0, not_a_number),
    Row('maps', '1 x 1 texel', SAME_FORM, 1, 0.01, one_texel),
    *[Row('half-floats', 'radiance ' + tried, 'the map within 0.05 %', x, 5e-4, half_floats) for tried, x in (
        ('1', 1.0), ('1e5, beyond half floats', 1e5), ('1e-7, below half floats', 1e-7))],
    Row('cells', '0.1 m', 'the same bits as with the default', 0.1, 0, cells),
    Row('cells', '1000 m', 'the same bits as with the default', 1000, 0, cells),
    Row('samples', '1 of each kind', "a furnace's walls within 3 %", 1, 0.03, few_samples),
    Row('samples', '10^6', "a furnace's walls within 0.02 %", 1e6, 2e-4, many_samples),
    *[Row('furnace', 'albedo %g' % x, FURNACE_FORM, x, 0.003, run_furnace) for x in (0.5, 0.99, 0.999)],
    Row('furnace', 'albedo 1', 'no end: said', 1, 0, run_furnace),
    *[Row('coincident', tried, SHEETS, x, 0.003, coincident) for x, tried in enumerate((
        'two opposite faces in a furnace', 'the same in the other order', 'with the same diagonal',
        'the same in the other order'))],
    *[Row('coincident', tried, 'closed form at each texel, and a note', x, 0.01, doubled) for x, tried in enumerate((
        'two floors that face the same way', 'the same with another diagonal'))],
    Row('largest-map', '16384 x 16384 texels', FLOOR_FORM, 16384, 0.01, largest_map, True)]


def choose(names):
    groups = list(dict.fromkeys(row.group for row in ROWS))
    for name in names:
        if name not in groups:
            raise Failure(child.USAGE, "no rows are called '%s'; there are: %s" % (name, ', '.join(groups)))
    return [row for row in ROWS if (row.group in names if names else not row.by_name_only)]


def try_rows(rows, given, show):
    """Runs the rows; returns what --json says of each."""
    found = []
    with tempfile.TemporaryDirectory(prefix='kiln-bench-') as scratch:
        for row in rows:
            begin = time.monotonic()
            try:
                with np.errstate(all='ignore'):
                    holds, measured = row.run(Trial(scratch, given), row)
            except Refused as refused:
                holds, measured = False, str(refused)
            found.append({'row': row.group, 'tried': row.tried, 'expected': row.expected, 'tolerance': row.tolerance,
                          'measured': measured, 'holds': bool(holds), 'seconds': time.monotonic() - begin})
            if show:
                print('%-13s%-50s%-46s%-56s%s' % (row.group, row.tried, row.expected, measured,
                                                  'yes' if holds else 'NO'), flush=True)
    return found


def run():
    made = options.parser('stability', __doc__, '[ROW ...]')
    arguments, given = options.parse(made, sys.argv[1:], ['bake'])
    rows = choose(arguments.words)
    if not arguments.json:
        print('%-13s%-50s%-46s%-56s%s' % ('row', 'what is tried', 'expected', 'measured', 'holds'))
    found = try_rows(rows, given, not arguments.json)
    failed = sum(not row['holds'] for row in found)
    if arguments.json:
        print(json.dumps({'status': 'done', 'rows_tried': len(found), 'rows_that_do_not_hold': failed, 'rows': found}))
    else:
        print('%d rows, %d of them do not hold' % (len(found), failed), flush=True)
    if failed:
        failure = Failure(child.BUG, '%d of %d rows of the table do not hold' % (failed, len(found)))
        failure.answered = True
        raise failure


if __name__ == '__main__':
    child.main(run, 'h5py')
