"""Kiln and Blender's Cycles bake the same texels of a scene with 4 bounces: processor time of each to 1 % error.

  /usr/bin/python3 tests/bench/cycles.py --kiln build/release/kiln [--only raw|denoised] [SCENE ...]

Scenes are cornell, rooms, dining_room and crytek_sponza, all without one; those that are not beside the checkout are
left out. Kiln lays the texels out; Cycles bakes the scene.glb of such a bake, all lightmaps in one atlas. Suns and
constant skies are carried over, and Sponza has a sky of 0.35 0.45 0.6 W m-2 sr-1 in both.

The error is nrmse, the root mean square difference over the mean, over texels wholly inside charts and not buried, of
each baker against its own converged result: two bakes of many samples by other seeds, A and B, whose noise is not in
the mean of (x - A) (x - B). Objects with alpha masks, and what reflects nothing, are baked but not counted. Cycles runs
a quarter of its samples and all of them, and the samples that 1 % takes follow from the power law through the two; they
cost what each further one did.

Kiln's samples are those that a search finds by the shares of direct and of indirect light in the error; three bakes by
other seeds are then timed, and their errors shown. Times are seconds of the processor (user and system) of the whole
process with import and files for kiln, and of the bake operator alone for Cycles; wall clocks stand beside them. Needs
Debian's package blender, which is built without a denoiser: Cycles' own cannot be shown with it.
"""
import json
import math
import os
import shutil
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import cornell_atlas  # noqa: E402
import measure  # noqa: E402
import harness  # noqa: E402

TARGET = 0.01
HOW = {'none': 'raw', 'regression': 'denoised'}
CONVERGED = (512, 32, 1024)  # direct, bounce, indirect
PARTS = ('', 'direct.', 'indirect.')
MARGIN = 2
RUNGS = (1, 8)  # an octave: direct samples are powers of two, as others have more error


class Scene:
    """What is baked, and how many samples Cycles takes to come near 1 %."""

    def __init__(self, path, samples, density=(), sky=None, shared=False):
        self.path, self.samples, self.density, self.sky, self.shared = path, samples, density, sky, shared

    def options(self):
        return (*self.density, *(('--environment', ','.join(map(str, self.sky))) if self.sky else ()))


def cornell(kiln):
    path = os.path.join(kiln.scratch, 'cornell_atlas.glb')
    cornell_atlas.write(path)
    return Scene(path, 64, ('--lightmap-size', 256, '--objects', '{lamp: {role: caster-only}}'), shared=True)


def third_party(name, samples, density, sky):
    path = os.path.join(harness.SHARED, 'third_party', name + '.glb')
    return Scene(path, samples, ('--texels-per-metre', density), sky) if os.path.exists(path) else None


SCENES = {
    'cornell': cornell,
    'rooms': lambda kiln: Scene(measure.made(kiln, 'rooms', '--columns', 3, '--rows', 1), 128,
                                ('--texels-per-metre', 8)),
    'dining_room': lambda kiln: third_party('dining_room', 64, 2.5, (0.5, 0.65, 0.9)),
    'crytek_sponza': lambda kiln: third_party('crytek_sponza', 32, 1.2, (0.35, 0.45, 0.6)),
}


class Atlas:
    """Where the lightmaps of a bake lie in one image: `places` {object: (x, y, width, height)} in texels."""

    def __init__(self, bake, shared):
        self.places, self.shape = {}, [0, 0]
        mapped = [o for o in bake.run['objects'] if o['lightmap']]
        sizes = sorted(((o['height'], o['width'], o['name']) for o in mapped), reverse=True)
        across = max(sizes[0][1], int(1.1 * math.sqrt(sum((w + MARGIN) * (h + MARGIN) for h, w, _ in sizes))))
        x = y = below = 0
        for height, width, name in sizes:
            if shared:
                x = y = 0
            elif x + width > across:
                x, y, below = 0, below, below
            self.places[name] = (x, y, width, height)
            self.shape = [max(self.shape[0], x + width), max(self.shape[1], y + height)]
            below, x = max(below, y + height + MARGIN), x + width + MARGIN

    def blank(self, *more, kind=float):
        return np.zeros((self.shape[1], self.shape[0], *more), kind)

    def of(self, image, name):
        x, y, width, height = self.places[name]
        return image[y:y + height, x:x + width]

    def counted(self, bakes):
        """{object: texels} wholly inside charts and in no bake buried, of objects without alpha masks."""
        masked = with_masks(os.path.join(bakes[0].directory, 'scene.glb'))
        return {name: np.all([(b.lightmap(name).channels[c] == 1) for b in bakes
                              for c in ('coverage.Y', 'validity.Y')], 0) for name in self.places if name not in masked}

    def light(self, bake, counted, part=''):
        image = self.blank(3)
        for name, mask in counted.items():
            channels = bake.lightmap(name).channels
            self.of(image, name)[mask] = np.stack([channels[part + c][mask] for c in 'RGB'], -1)
        return image


def with_masks(path):
    """Names of the nodes with a material that has an alpha mask."""
    with open(path, 'rb') as f:
        data = f.read()
    gltf = json.loads(data[20:20 + int.from_bytes(data[12:16], 'little')])
    masks = {i for i, m in enumerate(gltf['materials']) if m.get('alphaMode') == 'MASK'}
    return {n['name'] for n in gltf['nodes'] if 'mesh' in n
            and masks & {p.get('material') for p in gltf['meshes'][n['mesh']]['primitives']}}


def error(test, references, scale):
    """nrmse of `test`, without the noise of two references that know nothing of one another."""
    product = (test - references[0]) * (test - references[1])
    return math.sqrt(max(float(product.mean()), 0.0)) / scale


class KilnBaker:
    """Bakes of one scene by kiln, and their errors."""

    def __init__(self, kiln, scene, threads):
        self.kiln, self.scene, self.threads = kiln, scene, threads
        bakes = [self.bake(CONVERGED, seed, 'none') for seed in (98, 99)]
        self.atlas = Atlas(bakes[0], scene.shared)
        self.counted = self.atlas.counted(bakes)
        self.inside = self.atlas.blank(kind=bool)
        for name, mask in self.counted.items():
            self.atlas.of(self.inside, name)[mask] = True
        self.references = {part: [self.atlas.light(b, self.counted, part) for b in bakes] for part in PARTS}
        self.laid_out = os.path.join(bakes[0].directory, 'scene.glb')

    def bake(self, samples, seed, denoise):
        direct, bounce, indirect = samples
        return measure.must(self.kiln.bake(
            self.scene.path, '--bounces', 4, '--threads', self.threads, '--samples-direct', direct, '--samples-bounce',
            bounce, '--samples-indirect', indirect, '--samples-probe', 0, '--seed', seed, '--denoise', denoise,
            *self.scene.options(), timeout=3600))

    def errors(self, bake):
        """Of all light, direct and indirect light, over the mean of all light."""
        scale = self.mean()
        return [error(self.atlas.light(bake, self.counted, part)[self.inside],
                      [r[self.inside] for r in self.references[part]], scale) for part in PARTS]

    def mean(self):
        return float(np.mean([r[self.inside].mean() for r in self.references['']]))

    def trial(self, samples, seed, denoise, table):
        """(errors, Run)"""
        bake = self.bake(samples, seed, denoise)
        errors = self.errors(bake)
        bake.remove()
        table.row('kiln ' + HOW[denoise], '%d/%d/%d' % samples, *('%.3f %%' % (100 * e) for e in errors),
                  '%.2f' % bake.process.processor, '%.2f' % bake.process.seconds)
        return errors, bake.process


def whole(count, up, rungs):
    """A count on a ladder of so many rungs an octave, 16 at least."""
    rung = rungs * math.log2(max(count, 16.0))
    return 4 * round(2.0 ** ((math.ceil(rung - 1e-6) if up else math.floor(rung + 1e-6)) / rungs) / 4)


def samples_of(direct, indirect):
    return direct, max(4, min(64, indirect // 16)), indirect


def more_samples(counts, parts):
    """What direct and indirect light need so that both together come to the target."""
    result = []
    for count, own, other, rungs in zip(counts, parts, reversed(parts), RUNGS):
        allowed = math.sqrt(TARGET ** 2 - min(other, TARGET / math.sqrt(2)) ** 2)
        factor = min(4.0, max(1.1, (own / allowed) ** 1.5))
        result.append(whole(count * factor, True, rungs) if own > allowed else count)
    if result == list(counts):  # both a little too large for their sum
        result = [whole(c * 1.1, True, rungs) for c, rungs in zip(counts, RUNGS)]
    return result


def search(baker, denoise, counts, table):
    """Samples that reach the target with little to spare, sought from `counts` of direct and indirect light on."""
    for seed in range(1, 14):
        errors, _ = baker.trial(samples_of(*counts), seed, denoise, table)
        if errors[0] <= TARGET:
            break
        counts = more_samples(counts, errors[1:])
    else:
        sys.exit('kiln did not reach 1 %')
    for seed in (14, 15, 16):
        if errors[0] > 0.85 * TARGET:
            break
        fewer = [whole(c * (errors[0] / TARGET) ** 1.2, False, rungs) for c, rungs in zip(counts, RUNGS)]
        if fewer == counts:
            break
        errors, _ = baker.trial(samples_of(*fewer), seed, denoise, table)
        if errors[0] > TARGET:
            break
        counts = fewer
    return samples_of(*counts)


def run_cycles(baker, folder, runs, bounces=4, whole=False):
    """Bakes [(samples, seed), ...]: (records, images in W/m2, processor seconds of the whole process). `whole`: metal
    and glass as they are."""
    plan = os.path.join(folder, 'plan.json')
    sky = baker.scene.sky or (0, 0, 0)
    with open(plan, 'w') as f:
        json.dump({'scene': baker.laid_out, 'folder': folder, 'places': baker.atlas.places,
                   'atlas': baker.atlas.shape, 'sky': sky, 'bounces': bounces, 'whole': whole,
                   'threads': baker.threads}, f)
    p = harness.run(['blender', '--background', '-noaudio', '--factory-startup', '--python',
                     os.path.join(os.path.dirname(os.path.abspath(__file__)), 'cycles_bake.py'), '--', plan]
                    + ['%d:%d' % r for r in runs], timeout=7200)
    records = [json.loads(l[5:]) for l in p.stdout.splitlines() if l.startswith('BAKE ')]
    if len(records) != len(runs):
        sys.exit('blender made %d of %d bakes:\n%s' % (len(records), len(runs), (p.stdout + p.stderr)[-2000:]))
    images = []
    for record in records:
        channels, _ = harness.read_exr(record['file'])
        images.append(math.pi * np.stack([channels[c] for c in 'RGB'], -1).astype(float))
    return records, images, p.processor


def cycles_to_target(baker, folder, samples, table):
    """(processor seconds, wall seconds) of the bake operator at the target, after the rows that they follow from."""
    few = max(1, samples // 4)
    records, images, process = run_cycles(baker, folder, [(few, 1), (samples, 2), (samples, 3), (samples, 4)])
    ours = np.mean(baker.references[''], 0)
    black = baker.inside & (np.sum(images[1:], 0) == 0).any(-1) & (ours.mean(-1) > 0.01 * baker.mean())
    counted = baker.inside & ~black
    images = [i[counted] for i in images]
    scale = float(np.mean(images[1:]))
    print('%d texels that do not reflect all colours are not counted; means of the others: kiln %.5f, Cycles %.5f W/m2,'
          ' ratio %.4f' % (black.sum(), ours[counted].mean(), scale, ours[counted].mean() / scale))
    e_few = error(images[0], images[2:], scale)
    e_all = math.sqrt(np.mean([error(images[i], [images[j] for j in (1, 2, 3) if j != i], scale) ** 2
                               for i in (1, 2, 3)]))
    costs = {key: (records[0][key], float(np.median([r[key] for r in records[1:]])))
             for key in ('processor', 'seconds')}
    for i, (count, e) in enumerate(((few, e_few), (samples, e_all))):
        table.row('cycles', count, '%.3f %%' % (100 * e), '', '', '%.2f' % costs['processor'][i],
                  '%.2f' % costs['seconds'][i])
    needed = measure.at_error([(e_few, few), (e_all, samples)], TARGET)
    at = {key: c[1] + (needed - samples) * (c[1] - c[0]) / (samples - few) for key, c in costs.items()}
    rest = process - sum(r['processor'] for r in records)
    table.row('cycles', '%.0f (scaled)' % needed, '1 %', '', '', '%.1f' % at['processor'], '%.1f' % at['seconds'])
    print('error falls with the samples to the power %.2f; start, import and files take %.1f s of the processor more' %
          (math.log(e_few / e_all) / math.log(samples / few), rest))
    return at['processor'], at['seconds']


def compare(kiln, name, scene, arguments):
    print('\n%s, %d threads' % (name, arguments.threads))
    baker = KilnBaker(kiln, scene, arguments.threads)
    print('%d texels count, of %d in an atlas of %d x %d; %.1f texels a metre' % (
        baker.inside.sum(), sum(w * h for _, _, w, h in baker.atlas.places.values()), *baker.atlas.shape,
        0 if scene.shared else scene.density[1]))
    table = harness.Table(('baker', 13), ('samples', 15), ('nrmse', 9), ('direct', 9), ('indirect', 9),
                          ('processor s', 12), ('wall s', 9))
    rungs = {how: search(baker, how, arguments.begin, table) for how in HOW if arguments.only in (None, HOW[how])}
    folder = os.path.join(kiln.scratch, name)
    os.makedirs(folder, exist_ok=True)
    took, wall = cycles_to_target(baker, folder, arguments.cycles_samples or scene.samples, table)
    ends = []
    for how, samples in rungs.items():
        trials = [baker.trial(samples, 20 + i, how, table) for i in range(arguments.repeats)]
        own, clock = (float(np.median(x)) for x in zip(*((p.processor, p.seconds) for _, p in trials)))
        ends.append('%s to 1 %%: Cycles %.1f s, kiln %s %.2f s of the processor, %.3g times (wall clocks: %.3g)' %
                    (name, took, HOW[how], own, took / own, wall / clock))
    print('\n'.join(ends), flush=True)


def main():
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--cycles-samples', type=int, default=0, help='0: what suits each scene'),
        lambda p: p.add_argument('--threads', type=int, default=1, help='of both'),
        lambda p: p.add_argument('--only', choices=[*HOW.values()], help='bakes of kiln (both)'),
        lambda p: p.add_argument('--begin', type=int, nargs=2, default=[64, 32],
                                 help='direct and indirect samples that the search begins with'),
        lambda p: p.add_argument('--repeats', type=int, default=3),
        lambda p: p.add_argument('scenes', nargs='*', choices=[*SCENES, []]))
    if shutil.which('blender') is None:
        harness.skip("blender is not installed (Debian's package blender)")
    for name in arguments.scenes or SCENES:
        scene = SCENES[name](kiln)
        if scene is None:
            print('\n%s is not in ../shared/scenes/third_party: left out' % name)
        else:
            compare(kiln, name, scene, arguments)


if __name__ == '__main__':
    main()
