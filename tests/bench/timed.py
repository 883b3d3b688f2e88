"""What `--time` makes of the time: bakes of a scene with several times, whether the whole process ends in each, and how
near.

  /usr/bin/python3 tests/bench/timed.py --kiln build/release/kiln [--backend embree|vulkan] [--times 5,20,60]
      [--texels N] [--folder DIR ...] [--options '...'] [SCENE ...]

Scenes are as in expected.py; without any: Cornell box, door ajar, dining room, Sponza, living room. A row is a bake:
seconds given, seconds of the whole process, and these over those; rounds; the error expected before the light, and the
error reached, which has to fall from row to row. `LATE` marks a process that took longer than its time, `EARLY` one
that left more than a twentieth of it while its light could still be better, `WORSE` an error that did not fall.
"""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import expected  # noqa: E402
import harness  # noqa: E402

SCENES = ('cornell', 'door_ajar', 'dining_room', 'sponza', 'living_room')
LEFT = 0.05  # of the time
FINE = 0.005  # error that ends a bake with a time


def marks(given, seconds, error, before):
    return ' '.join(word for word, applies in (
        ('LATE', seconds > given), ('EARLY', seconds < (1 - LEFT) * given and error > FINE),
        ('WORSE', before is not None and error > before)) if applies)


def main():
    def more(parser):
        parser.add_argument('--times', default='5,20,60')
    arguments, kiln = harness.start(__doc__, expected.more, more)
    arguments.scenes = arguments.scenes or SCENES
    table = harness.Table(('scene', 16), ('given, s', 8), ('taken, s', 8), ('over', 6), ('rounds', 6),
                          ('expected, %', 11), ('error, %', 9), ('', 16))
    for name, path, options in expected.scenes_of(kiln, arguments):
        before = None
        for given in map(float, arguments.times.split(',')):
            bake = expected.baked(kiln, path, arguments.backend, os.path.join(kiln.scratch, 'kernels'),
                                  (*options, '--time', given))
            error, seconds = bake.run['error']['published'], bake.process.seconds
            table.row(name, '%g' % given, '%.1f' % seconds, '%.2f' % (seconds / given), bake.run['error']['rounds'],
                      '%.2g' % (100 * bake.run.get('foretold', {}).get('error', 0.0)), '%.2g' % (100 * error),
                      marks(given, seconds, error, before))
            before = error
            bake.remove()


if __name__ == '__main__':
    main()
