"""Pictures of a scene at equal time: baked raw and denoised, `draft` and `preview`.

  /usr/bin/python3 tests/bench/pictures.py --kiln build/release/kiln --picture OUT.jpg [--texels-per-metre X]
                                           [--width N] [--options '...'] SCENE

The denoised bakes are those of the presets. The raw ones have the preset's numbers of samples, all times the same
factor, such that the whole process takes as many seconds of the processor (user and system), within 3 % or as near as
four bakes come. The picture has two rows, `draft` and `preview`; raw is left, denoised right, all through the scene's
camera with its automatic exposure. Needs Debian's package imagemagick.
"""
import os
import shlex
import shutil
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

PRESETS = {'draft': (64, 4, 32), 'preview': (64, 8, 128)}  # direct, bounce, indirect
CLOSE = 0.03
ROUNDS = 4


class Studio:
    def __init__(self, kiln, scene, arguments):
        self.kiln, self.scene, self.width = kiln, scene, arguments.width
        self.options = ['--texels-per-metre', arguments.texels_per_metre, '--threads', 1, '--samples-probe', 0,
                        *shlex.split(arguments.options)]

    def bake(self, quality, samples, denoise):
        bake = measure.must(self.kiln.bake(
            self.scene, '--quality', quality, '--samples-direct', samples[0], '--samples-bounce', samples[1],
            '--samples-indirect', samples[2], '--denoise', denoise, *self.options, timeout=3600))
        print('%s %s %d/%d/%d: %.2f s of the processor' % (quality, denoise, *samples, bake.process.processor),
              flush=True)
        return bake

    def as_long(self, quality, seconds):
        """The raw bake that takes `seconds` of the processor."""
        factor, least, most = 1.0, 1.0, 16.0
        for _ in range(ROUNDS):
            samples = [max(1, round(s * factor)) for s in PRESETS[quality]]
            bake = self.bake(quality, samples, 'none')
            off = bake.process.processor / seconds - 1
            if abs(off) <= CLOSE:
                break
            least, most = (factor, most) if off < 0 else (least, factor)
            passes = measure.tracing_seconds(bake) / bake.process.seconds * bake.process.processor
            factor = min(most, max(least, factor * max(0.5, 1 + (seconds - bake.process.processor) / passes)))
        return bake

    def view(self, bake):
        path = os.path.join(bake.directory, 'view.png')
        p = self.kiln.command('view', bake.directory, '-o', path, '--width', self.width, '--threads', 1, '--quiet')
        if p.status != 0:
            sys.exit('%s\nended with %d: %s' % (p.line(), p.status, p.sentence()))
        return path


def main():
    def more(parser):
        parser.add_argument('--picture', required=True)
        parser.add_argument('--texels-per-metre', type=float, default=6)
        parser.add_argument('--width', type=int, default=480)
        parser.add_argument('--options', default='', help='more options for kiln bake, in one string')
        parser.add_argument('scene')
    arguments, kiln = harness.start(__doc__, more)
    if shutil.which('montage') is None:
        harness.skip("montage is not installed (Debian's package imagemagick)")
    studio = Studio(kiln, arguments.scene, arguments)
    pictures = []
    for quality, samples in PRESETS.items():
        denoised = studio.bake(quality, samples, 'regression')
        raw = studio.as_long(quality, denoised.process.processor)
        pictures += [studio.view(b) for b in (raw, denoised)]
    made = harness.run(['montage', *pictures, '-tile', '2x2', '-geometry', '+2+2', '-quality', '88', arguments.picture])
    if made.status != 0:
        sys.exit('montage: ' + made.sentence())


if __name__ == '__main__':
    main()
