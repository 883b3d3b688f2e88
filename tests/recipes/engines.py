"""Does a bake arrive in an engine? Scenes without a lightmap layout are baked; the engine loads DIR/scene.glb and the
lightmaps by its own means and by the recipe in jobs/recipes, and what it shows at 200 random places is compared with
the irradiance there (stage.py says how).

  engines.py [three] [blender] --kiln KILN [--scene FILE.glb [--lamp X Y Z SIDE]] [--places N] [--density D] [--atlas N]
  [--pictures FOLDER]

three needs Chromium and a folder with three in it, named by KILN_THREE (npm install --prefix FOLDER three); blender
needs Blender. --lamp replaces the scene's lights by a square lamp that looks down: noise and hard shadows would hide
what is looked for. tests/NOTES.md has the run of the dining room.
"""
import json
import os
import shutil
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import browser  # noqa: E402
import stage  # noqa: E402
import glb  # noqa: E402
import harness  # noqa: E402

HERE = os.path.dirname(os.path.abspath(__file__))
SAMPLES = ('--samples-direct', 512, '--samples-bounce', 32, '--samples-indirect', 1024, '--samples-probe', 0,
           '--bounces', 4)
TOLERANCE, SHARES = 0.02, (0.98, 0.95)  # 2 %; so many of the even places, and of the others: see stage.judge
# three's standard material keeps back what its specular layer takes: 4 % seen from above, 8 with roughness
ALBEDO_TOLERANCE = 0.08


def with_lamp(path, copy, lamp):
    """The scene with one square lamp, facing down, instead of its lights and its sky."""
    scene = glb.Scene()
    scene.load(path)
    x, y, z, side = lamp
    for root in scene.document['scenes']:
        root.pop('extras', None)
    for node in scene.document['nodes']:
        if 'KHR_lights_punctual' in node.get('extensions', {}):
            del node['extensions']
    scene.document.get('extensions', {}).pop('KHR_lights_punctual', None)
    if not scene.document.get('extensions', True):
        del scene.document['extensions']
    scene.used.discard('KHR_lights_punctual')
    h = side / 2
    scene.quad('test lamp', [(x - h, y, z - h), (x + h, y, z - h), (x + h, y, z + h), (x - h, y, z + h)],
               scene.material('test lamp', radiance=(10, 9, 8)))
    return scene.write(copy)


class Stage:
    """One scene, baked twice, and places on it."""

    def __init__(self, kiln, checks, path, arguments):
        self.name = os.path.splitext(os.path.basename(path))[0]
        copy = lambda what: os.path.join(kiln.scratch, '%s_%s.glb' % (self.name, what))
        whole = with_lamp(path, copy('lamp'), arguments.lamp) if arguments.lamp else path
        self.source = stage.strip(whole, copy('stripped'))
        density = ('--texels-per-metre', arguments.density) if arguments.density else ()
        self.bake = kiln.bake(self.source, *SAMPLES, '--seed', 1, *density, timeout=3600)
        reference = kiln.bake(whole, *SAMPLES, '--seed', 2, *density, timeout=3600)
        self.good = checks.baked(self.bake) and checks.baked(reference)
        if not self.good:
            return
        self.folder = self.bake.directory
        if arguments.atlas:
            self.folder = os.path.join(kiln.scratch, self.name + '_atlas')
            p = kiln.command('export', self.bake.directory, '-o', os.path.join(self.folder, 'scene.glb'), '--atlas',
                             arguments.atlas)
            self.good = checks.that(p.status == 0, 'kiln export --atlas ended with %d' % p.status, p)
            if not self.good:
                return
        self.scene = stage.Scene(os.path.join(self.folder, 'scene.glb'))
        self.found, vain = stage.places(self.scene, stage.Reference(reference), arguments.places, 3)
        checks.that(len(self.found) == arguments.places,
                    '%s: only %d places have an answer' % (self.name, len(self.found)))
        self.request = dict(reach=stage.reach_of(self.scene), places=[
            dict(position=f['position'].tolist(), normal=f['normal'].tolist()) for f in self.found])
        print('%s: %d places, %d others without an answer (buried, or smaller than texels)' %
              (self.name, len(self.found), vain), flush=True)


def radiance(checks, engine, seen, tolerance):
    """What the materials show must be darker than E / pi, and be lit: albedo lies between 0 and 1 in each channel."""
    pairs = [(np.array(s['radiance']), np.array(s['irradiance']) / np.pi) for s in seen if s['radiance'] is not None
             and s['irradiance'] is not None]
    over = [bool((r > e * (1 + tolerance) + 1e-6).any()) for r, e in pairs]
    lit = [bool(r.max() > 0) for r, e in pairs if e.max() > 0]
    checks.that(np.mean(lit) > 0.5, '%s: the materials show no light' % engine)
    return sum(over)


def three_modules():
    return os.path.join(os.environ.get('KILN_THREE', ''), 'node_modules')


def missing(engine):
    """What is not installed, as a sentence, or None."""
    if engine == 'blender':
        return None if shutil.which('blender') else "blender is not installed (Debian's package blender)"
    if browser.find() is None:
        return "chromium is not installed (Debian's package chromium)"
    there = os.path.exists(os.path.join(three_modules(), 'three', 'package.json'))
    return None if there else 'KILN_THREE names no folder with three: npm install --prefix FOLDER three'


def in_three(checks, table, kiln, stages, arguments):
    chromium, modules = browser.find(), three_modules()
    for s in stages:
        folders = {'': HERE, 'recipe': os.path.join(stage.RECIPES, 'three'), 'bake': s.folder, 'node_modules': modules}
        server = browser.Server(folders, {'places.json': json.dumps(s.request).encode()})
        answer = browser.ask(chromium, server, 'probe.html', 600)
        server.close()
        if not checks.that('error' not in answer, 'three.js: %s' % answer.get('error')):
            continue
        stage.judge(checks, table(), 'three.js r%s %s' % (answer['three'], s.name), s.found, answer['places'],
                    TOLERANCE, SHARES)
        checks.that(answer['done']['nodes'] == len(s.bake.run['objects']), 'three.js: %d of %d objects got a lightmap' %
                    (
            answer['done']['nodes'], len(s.bake.run['objects'])))
        radiance(checks, 'three.js', answer['places'], ALBEDO_TOLERANCE)
        server = browser.Server({**folders, '': folders['recipe']}, {})
        page = browser.document(chromium, server, 'index.html?bake=bake/')
        checks.that('<title>ready</title>' in page, 'index.html does not draw: ' + page[:2000])
        if arguments.pictures:
            browser.screenshot(chromium, server, 'index.html?bake=bake/',
                               os.path.join(arguments.pictures, 'three-%s.png' % s.name))
        server.close()


def blender(script, *arguments, blend=()):
    return harness.run(['blender', '--background', '-noaudio', '--factory-startup', '--python-exit-code', '1', *blend,
                        '--python', script, '--',
                        *arguments], timeout=1800)


def in_blender(checks, table, kiln, stages, arguments):
    for s in stages:
        files = {n: os.path.join(kiln.scratch, s.name + n)
                 for n in ('places.json', 'seen.json', 'own.blend', 'own.json')}
        with open(files['places.json'], 'w') as f:
            json.dump(s.request, f)
        picture = [os.path.join(arguments.pictures, 'blender-%s.png' % s.name)] if arguments.pictures else []
        recipe, probe = os.path.join(stage.RECIPES, 'blender.py'), os.path.join(HERE, 'blender_probe.py')
        runs = [('', files['seen.json'], ())]
        made = blender(os.path.join(HERE, 'blender_own.py'), s.source, files['own.blend'])
        if checks.that(made.status == 0, 'Blender makes no file of its own of %s' % s.name, made):
            runs.append((' own file', files['own.json'], (files['own.blend'],)))
        for what, result, blend in runs:
            p = blender(probe, recipe, s.folder, files['places.json'], result, *picture, blend=blend)
            picture = []
            if not checks.that(p.status == 0 and os.path.exists(result), 'blender.py ended with %d' % p.status, p):
                print(p.stdout[-3000:])
                continue
            print('\n'.join(l for l in p.stdout.splitlines() if l.startswith('kiln:')))
            with open(result) as f:
                answer = json.load(f)
            stage.judge(checks, table(), 'Blender %s %s%s' % (answer['version'], s.name, what), s.found,
                        answer['places'], TOLERANCE, SHARES)
            over = radiance(checks, 'Blender', answer['places'], 1e-3)
            checks.that(what != '' or over <= 0.1 * len(s.found), 'Blender: %d places send out more than E / pi' % over)


ENGINES = {'three': in_three, 'blender': in_blender}


def main():
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('engines', nargs='+', choices=sorted(ENGINES)),
        lambda p: p.add_argument('--scene', metavar='FILE.glb'),
        lambda p: p.add_argument('--lamp', nargs=4, type=float, metavar=('X', 'Y', 'Z', 'SIDE')),
        lambda p: p.add_argument('--places', type=int, default=200),
        lambda p: p.add_argument('--density', type=float, metavar='TEXELS_PER_METRE'),
        lambda p: p.add_argument('--atlas', type=int, default=0, metavar='TEXELS',
                                 help='look at what kiln export --atlas makes of the bake'),
        lambda p: p.add_argument('--pictures', metavar='FOLDER'))
    for engine in arguments.engines:
        if missing(engine):
            harness.skip(missing(engine))
    if arguments.pictures:
        os.makedirs(arguments.pictures, exist_ok=True)
    checks, stages = harness.Checks(), []
    if arguments.scene:
        stages.append(Stage(kiln, checks, arguments.scene, arguments))
    else:
        arguments.density = arguments.density or 12
        # its own lightmaps, and one page of all
        for name, arguments.atlas in (('cornell_original.glb', 0), ('punctual_zoo.glb', 512)):
            stages.append(Stage(kiln, checks, harness.own_scene(name), arguments))
    for engine in arguments.engines:
        ENGINES[engine](checks, stage.table, kiln, [s for s in stages if s.good], arguments)
    checks.end()


if __name__ == '__main__':
    main()
