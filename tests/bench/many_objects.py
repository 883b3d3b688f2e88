"""Bakes of many small objects: processor seconds of the whole process.

  /usr/bin/python3 tests/bench/many_objects.py --kiln build/release/kiln [--before OLD_KILN] [OBJECTS ...]

Single triangles above a floor, each an object with a lightmap of its own. With --before the last column says how many
times the processor time the other program takes.
"""
import os
import sys
import tempfile

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402, F401: it says where harness is
import harness  # noqa: E402
from study import child  # noqa: E402

CHEAP = ('--quality', 'draft', '--samples-direct', '64', '--samples-probe', '0', '--quiet')


def write_scene(path, count):
    side = int(count ** 0.5) + 1
    with open(path, 'w', encoding='utf-8') as file:
        file.write('o floor\nv -1 -0.1 -1\nv %d -0.1 -1\nv %d -0.1 %d\nv -1 -0.1 %d\nf -4 -3 -2 -1\n' % (4 * (side,)))
        for i in range(count):
            x, z = i % side, i // side
            file.write('o t%d\nv %g 0 %g\nv %g 0 %g\nv %g 0 %g\nf -1 -2 -3\n' % (i, x, z, x + .5, z, x, z + .5))


def processor_seconds(program, scene, folder):
    return child.run([program, 'bake', scene, '-o', folder, *CHEAP]).must('the bake').processor


def main():
    def more(parser):
        parser.add_argument('--before')
        parser.add_argument('objects', nargs='*', type=int, default=[1000, 10000])
    arguments, _ = harness.start(__doc__, more)
    table = harness.Table(('objects', 8), ('processor, s', 13), ('ms an object', 13), ('before / now', 13))
    for count in arguments.objects:
        with tempfile.TemporaryDirectory() as folder:
            scene = os.path.join(folder, 'objects.obj')
            write_scene(scene, count)
            now = processor_seconds(arguments.kiln, scene, os.path.join(folder, 'now'))
            ratio = '-'
            if arguments.before:
                ratio = '%.2f' % (processor_seconds(arguments.before, scene, os.path.join(folder, 'before')) / now)
            table.row(count, '%.2f' % now, '%.2f' % (1e3 * now / count), ratio)


if __name__ == '__main__':
    main()
