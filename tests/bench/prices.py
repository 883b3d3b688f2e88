"""What a scene pays for lights and textures that bring nothing: instructions of a bake with them over one without.

  /usr/bin/python3 tests/bench/prices.py --kiln build/release/kiln [--texels-per-metre 3]

The Cornell box, with a texture of 1 x 1 as emission of its lamp, with one point light of 1e-8 cd, with a hundred of
them, and with a sky of 1e-8 W m-2 sr-1. The first columns are of direct light alone (256 samples, no bounces), the next
of a whole bake (`draft`, 4 bounces), each with what is more than in the plain box; the last is the memory of the whole
bake without valgrind. Valgrind's callgrind counts the instructions of the process, all of it but the confined importer:
the count hangs neither on the machine's load nor, but for a ten-thousandth, on the run. Needs Debian's package valgrind
and a C compiler. callgrind knows AVX2, not AVX-512.
"""
import base64
import os
import re
import shutil
import struct
import sys
import zlib

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402
import glb  # noqa: E402

DIM = 1e-8
BOX = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
BAKES = (('--quality', 'draft', '--samples-direct', 256, '--bounces', 0),
         ('--quality', 'draft', '--samples-direct', 64, '--bounces', 4))


def white_texel():
    chunk = lambda kind, data: b''.join((struct.pack('>I', len(data)), kind, data,
                                         struct.pack('>I', zlib.crc32(kind + data))))
    return (b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', 1, 1, 8, 2, 0, 0, 0))
            + chunk(b'IDAT', zlib.compress(b'\x00\xff\xff\xff')) + chunk(b'IEND', b''))


def textured(scene):
    scene.document['images'] = [{'uri': 'data:image/png;base64,' + base64.b64encode(white_texel()).decode()}]
    scene.document['textures'] = [{'source': 0}]
    for material in scene.document['materials']:
        if 'emissiveFactor' in material:
            material['emissiveTexture'] = {'index': 0}


def lights(count):
    def add(scene):
        for i in range(count):
            place = [0.5 + 4.5 * (i % 10) / 10, 0.5 + 4.5 * (i // 10) / 10, 0.5 + 4.5 * (7 * i % 10) / 10]
            scene.light('dim%d' % i, {'type': 'point', 'color': [1, 1, 1], 'intensity': DIM}, translation=place)
    return add


VARIANTS = (('plain', lambda scene: None), ('plain again', lambda scene: None), ('emission texture 1 x 1', textured),
            ('one dim light', lights(1)), ('100 dim lights', lights(100)),
            ('dim sky', lambda scene: scene.environment((DIM,) * 3)))


class Counter:
    """Counts the instructions of kiln."""

    def __init__(self, kiln, density):
        self.kiln, self.density = kiln, density
        self.library = os.path.join(kiln.scratch, 'own_program.so')
        source = os.path.join(os.path.dirname(os.path.abspath(__file__)), 'own_program.c')
        self.must(harness.run(['cc', '-std=c17', '-shared', '-fPIC', '-o', self.library, source, '-ldl']))

    @staticmethod
    def must(process):
        if process.status != 0:
            sys.exit('%s\nended with %d: %s' % (process.line(), process.status, process.stderr[-1000:]))
        return process

    def options(self, more):
        return ['--texels-per-metre', str(self.density), '--samples-probe', '0', '--threads', '1', '--no-export',
                '--backend', 'embree', '--instruction-set', 'avx2', '--no-preview', '--quiet', *map(str, more)]

    def instructions(self, scene, more):
        folder = os.path.join(self.kiln.scratch, 'counted')
        command = ['valgrind', '--tool=callgrind', '--callgrind-out-file=/dev/null', self.kiln.path, 'bake', scene,
                   '-o', folder, *self.options(more)]
        environment = {**self.kiln.environment, 'OWN_PROGRAM': self.kiln.path, 'LD_PRELOAD': self.library}
        process = self.must(harness.run(command, 3600, environment))
        shutil.rmtree(folder)
        return int(re.search(r'Collected : (\d+)', process.stderr).group(1))

    def memory(self, scene, more):
        bake = measure.must(self.kiln.bake(scene, *self.options(more)[:-len(more)], *more))
        bake.remove()
        return bake.process.peak_bytes


def main():
    arguments, kiln = harness.start(__doc__, lambda p: p.add_argument('--texels-per-metre', type=float, default=3))
    if shutil.which('valgrind') is None:
        harness.skip("valgrind is not installed (Debian's package valgrind)")
    counter = Counter(kiln, arguments.texels_per_metre)
    table = harness.Table(('Cornell box', 24), ('direct, 1e6', 12), ('more', 9), ('bake, 1e6', 12), ('more', 9),
                          ('memory, MiB', 12))
    plain = None
    for name, change in VARIANTS:
        scene = glb.Scene()
        scene.load(BOX)
        change(scene)
        path = scene.write(os.path.join(kiln.scratch, 'box.glb'))
        counts = [counter.instructions(path, more) for more in BAKES]
        plain = plain or counts
        cells = [c for now, before in zip(counts, plain)
                 for c in ('%.1f' % (now / 1e6), '%+.2f %%' % (100 * (now / before - 1)))]
        table.row(name, *cells, '%.1f' % (counter.memory(path, BAKES[1]) / 2 ** 20))


if __name__ == '__main__':
    main()
