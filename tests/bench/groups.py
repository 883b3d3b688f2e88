"""What it costs to tell groups of lights apart.

  /usr/bin/python3 tests/bench/groups.py --kiln build/release/kiln [eight|day] [--texels-per-metre 0.5]

`eight`: processor time of a bake that tells eight groups apart over the same bake without, with as many shadow rays,
of a room with eight lamps and of eight point lights. `day` needs Sponza beside the repository: a bake with a sky of 145
patches and 24 suns, each a group, and a mixture for each of 24 hours, over one bake of a sun and a sky. A mixture's sky
is clear towards its sun: other factors for each patch and hour. One thread each, one after the other.
"""
import argparse
import json
import math
import os
import shutil
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

HOURS = 24
QUICK = ['--backend', 'embree', '--threads', '1', '--materials', 'diffuse', '--samples-probe', '0', '--no-preview',
         '--quiet']


def processor(command):
    run = harness.run([str(word) for word in command], timeout=3600)
    if run.status != 0:
        sys.exit(run.line() + '\n' + run.stderr)
    return run.processor


def lamps(path):
    """A room with eight square lamps under its ceiling."""
    scene = glb.Scene()
    wall = scene.material('wall', (0.7, 0.7, 0.7))
    glb.box(scene, 'room', (0, 0, 0), (8, 3, 4), wall, inward=range(6))
    for i in range(8):
        x, z = 1 + 2 * (i % 4), 1 + 2 * (i // 4)
        lamp = scene.material(f'lamp{i}', (0, 0, 0), (10, 8, 6))
        scene.quad(f'lamp{i}', [(x, 2.9, z), (x + 0.4, 2.9, z), (x + 0.4, 2.9, z + 0.4), (x, 2.9, z + 0.4)], lamp)
    return scene.write(path), ''.join(f'g{i}: {{materials: [lamp{i}]}}\n' for i in range(8))


def points(path):
    scene = glb.Scene()
    wall = scene.material('wall', (0.7, 0.7, 0.7))
    glb.box(scene, 'room', (0, 0, 0), (8, 3, 4), wall, inward=range(6))
    for i in range(8):
        scene.light(f'point{i}', {'type': 'point', 'name': f'point{i}', 'color': [1, 1, 1], 'intensity': 10.0},
                    translation=[1 + 2 * (i % 4), 2.5, 1 + 2 * (i // 4)])
    return scene.write(path), ''.join(f'g{i}: {{lights: [point{i}]}}\n' for i in range(8))


def eight(kiln, folder):
    print('scene            quality     without s  eight groups s  ratio')
    for name, make in (('eight lamps', lamps), ('eight points', points)):
        scene, groups = make(os.path.join(folder, 'scene.glb'))
        file = os.path.join(folder, 'groups.yaml')
        with open(file, 'w', encoding='utf-8') as out:
            out.write(groups)
        for quality in ('draft', 'preview'):
            bake = [kiln, 'bake', scene, *QUICK, '--quality', quality, '--samples-direct', 64, '--texels-per-metre', 24,
                    '-o', os.path.join(folder, 'out'), '--no-resume']
            plain, told = processor(bake), processor([*bake, '--light-groups', file])
            print(f'{name:16s} {quality:10s} {plain:10.2f} {told:15.2f} {told / plain:6.2f}', flush=True)


def sun(hour):
    """The rotation (x, y, z, w) that turns -z down from where the sun is: it goes round at 52 degrees to the north."""
    turn, tilt = 2 * math.pi * (hour - 12) / HOURS, -math.radians(60 if 6 <= hour < 18 else 12)
    a, b = math.sin(turn / 2), math.cos(turn / 2)
    c, d = math.sin(tilt / 2), math.cos(tilt / 2)
    return [b * c, a * d, -a * c, b * d]


def suns(scene, hours):
    for hour in hours:
        scene.light(f'sun{hour:02d}', {'type': 'directional', 'name': f'sun{hour:02d}', 'color': [1, 0.9, 0.8],
                                       'intensity': 5.0}, rotation=sun(hour))
    return scene


def sponza(path, hours):
    scene = glb.Scene()
    scene.load(harness.need_shared('third_party', 'crytek_sponza.glb'))
    return suns(scene, hours).write(path)


def factors(groups, hour):
    """Of a clear sky: brighter near the sun, darker at noon's far side."""
    turn = 2 * math.pi * (hour - 12) / HOURS
    for group in groups:
        if 'direction' in group:
            x, y, z = group['direction']
            yield group['name'], 0.3 + max(0.0, x * math.sin(turn) + z * math.cos(turn)) + 0.2 * y
        elif group['name'].startswith('hour'):
            yield group['name'], float(int(group['name'][4:]) == hour)


def day(kiln, folder, density):
    one, all_day = (sponza(os.path.join(folder, f'{len(hours)}.glb'), hours) for hours in ([12], range(HOURS)))
    file, out = os.path.join(folder, 'groups.yaml'), os.path.join(folder, 'groups')
    with open(file, 'w', encoding='utf-8') as yaml:
        yaml.write(''.join(f'hour{h:02d}: {{lights: [sun{h:02d}]}}\n' for h in range(HOURS)))
    bake = ['--environment', '0.5,0.6,0.8', *QUICK, '--quality', 'preview', '--samples-direct', 64,
            '--texels-per-metre', density]
    plain = processor([kiln, 'bake', one, *bake, '-o', os.path.join(folder, 'one')])
    print(f'one bake, a sun and a sky: {plain:.1f} s of the processor', flush=True)
    told = processor([kiln, 'bake', all_day, *bake, '--light-groups', file, '--sky-patches', 145, '-o', out])
    print(f'24 suns and 145 patches told apart: {told:.1f} s, {told / plain:.2f} bakes', flush=True)
    with open(os.path.join(out, 'run.json'), encoding='utf-8') as run:
        groups = json.load(run)['light_groups']
    mixed = 0.0
    for hour in range(HOURS):
        words = [word for name, factor in factors(groups, hour) for word in ('--set', f'{name}={factor:.4f}')]
        mixed += processor([kiln, 'mix', out, *words, '--quiet', '-o', os.path.join(folder, 'hour')])
    print(f'24 mixtures: {mixed:.1f} s, {mixed / plain:.2f} bakes; a day: {(told + mixed) / plain:.2f} bakes')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--kiln', required=True)
    parser.add_argument('what', nargs='?', choices=('eight', 'day'), default='eight')
    parser.add_argument('--texels-per-metre', type=float, default=0.5)
    arguments = parser.parse_args()
    folder = tempfile.mkdtemp()
    try:
        if arguments.what == 'eight':
            eight(arguments.kiln, folder)
        else:
            day(arguments.kiln, folder, arguments.texels_per_metre)
    finally:
        shutil.rmtree(folder)


if __name__ == '__main__':
    main()
