"""--keep-transport rows and kiln relight on a Vulkan device: what is looked up has the bits of what it traces.

A room with a lamp, a smooth ball and a pane with holes, and a sky about it. Kept transport changes no light. Nothing
changed, and colours changed, a relight has the bits of the device's bake, and traces no ray: from a file in small
pieces, with little memory and after the device was lost; and as one of several states, from rows that stay on the
device, where their light stays too: what returns is 16 bytes a point and sums of power. Direct light that is scaled by
parts is added up there, and 14 bytes more return. On two ranks the host does all that: the same bits and powers. Either
backend replays the rows of the other: the same light but for rounding. A damaged row is told of.
"""
import json
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'mpi')]
import glb  # noqa: E402
import harness  # noqa: E402
import same_result  # noqa: E402

OPTIONS = ('--texels-per-metre', 4, '--samples-direct', 16, '--samples-bounce', 16, '--samples-indirect', 64,
           '--samples-probe', 0, '--materials', 'diffuse', '--no-export', '--denoise', 'regression', '--bounces', 2)
WALL = {'materials': {'wall': {'albedo': [0.3, 0.6, 0.7]}}}
POWERS = ('absorbed', 'escaped', 'blocked', 'left_over', 'residual')
STATES = {'same': {}, 'dim': {'materials': {'glow': {'emission-scale': 0.5}}}, 'wall': WALL,
          'both': {'materials': {'glow': {'emission-scale': 0.3}, **WALL['materials']},
                   'environment': {'radiance': [0.5, 1.2, 0.3]}}}
MIXED = ('dim', 'both')  # their direct light is a sum of scaled parts


def room(path):
    scene = glb.Scene()
    wall = scene.material('wall', (0.7, 0.7, 0.6))
    pane = scene.material('pane', (0.4, 0.5, 0.4))
    scene.document['materials'][pane].update(alphaMode='BLEND')
    scene.document['materials'][pane]['pbrMetallicRoughness']['baseColorFactor'][3] = 0.5
    glb.box(scene, 'room', (0, 0, 0), (2, 2, 3), wall, inward=range(5))
    glb.ball(scene, 'ball', (0.6, 0.4, 0.7), 0.35, scene.material('ball', (0.8, 0.2, 0.2), double_sided=True), rings=8)
    glb.box(scene, 'lamp', (0.8, 1.7, 0.8), (1.2, 1.8, 1.2), scene.material('glow', (0.2, 0.2, 0.2), (5, 4, 3)))
    scene.quad('pane', ((1.2, 0.2, 1.9), (1.8, 0.2, 1.9), (1.8, 1.2, 1.7), (1.2, 1.2, 1.7)), pane)
    scene.environment((0.5, 0.6, 0.9))
    return scene.write(path)


def relight(kiln, checks, kept, name, *arguments, environment=None):
    """The bake that is relit; None where that fails."""
    folder = os.path.join(kiln.scratch, name)
    kiln.environment.update(environment or {})
    process = kiln.command('relight', kept.directory, *arguments, '--quiet', '--no-preview', '-o', folder)
    for key in environment or {}:
        del kiln.environment[key]
    bake = harness.Bake(folder, process)
    return bake if checks.baked(bake) else None


def is_as(checks, bake, wanted, what):
    if bake is not None:
        checks.that(same_result.points(bake) == wanted, '%s: other bits' % what, bake.process)


def is_near(checks, bake, wanted, backend, what):
    if bake is not None:
        off = np.abs(bake.points.total - wanted.points.total).max() / wanted.points.total.mean()
        checks.that(off < 1e-5, '%s: off by %g of the mean' % (what, off), bake.process)
        checks.that(bake.run['backend']['name'] == backend, '%s: not by %s' % (what, backend), bake.process)


def write(kiln, name, what):
    path = os.path.join(kiln.scratch, name)
    with open(path, 'w') as file:
        json.dump(what, file)
    return path


def check_states(kiln, checks, kept, wanted, colours):
    states = write(kiln, 'states.yaml', STATES)

    def run(name, ranks):
        folder = os.path.join(kiln.scratch, name)
        many = kiln.command('relight', kept.directory, '--states', states, '--quiet', '--no-preview', '-o', folder,
                            ranks=ranks)
        checks.that(many.status == 0, 'states: %d: %s' % (many.status, many.sentence()), many)
        with open(os.path.join(folder, 'states.json')) as file:
            returned = sum(state['returned_bytes'] for state in json.load(file)['states'])
        return {name: harness.Bake(os.path.join(folder, name), many) for name in STATES}, returned

    device, returned = run('many', 0)
    host, all_of_it = run('two', 2)
    is_as(checks, device['same'], wanted, 'the state of nothing changed')
    is_as(checks, device['wall'], colours, 'the state of other colours')
    for name in STATES:
        is_as(checks, host[name], same_result.points(device[name]), 'the state %s, taken over by the host' % name)
        ours, theirs = device[name].run['energy'], host[name].run['energy']
        checks.that(all(ours[key] == theirs[key] for key in POWERS), 'powers of the state %s: %s, by the host %s' %
                    (name, ours, theirs))
    points, kernels = kept.run['points']['count'], device['dim'].run['backend']['kernels']
    checks.that('gather from rows: taken over' in kernels, 'the host has taken answers over: %s' % kernels)
    checks.that('light that stays: direct' in kernels, 'the host has added up direct light: %s' % kernels)
    least = (16 * len(STATES) + 14 * len(MIXED)) * points
    once = 2 * 68 * points  # the first time that rays of each bounce are looked up, all that hangs on no light returns
    checks.that(least <= returned < least + once + 10000 < all_of_it, 'returned: %d, by one rank of two %d; %d points' %
                (returned, all_of_it, points))


def check_damaged(kiln, checks, kept):
    """A bit of a row is another, and no manifest says so."""
    os.remove(os.path.join(kept.directory, 'manifest'))
    folder = os.path.join(kept.directory, 'transport')
    path = os.path.join(folder, next(name for name in sorted(os.listdir(folder)) if name.startswith('rows-')))
    with open(path, 'r+b') as file:
        data = file.read()
        place = next(i for i in range(len(data) // 2, len(data)) if data[i])
        file.seek(place)
        file.write(bytes([data[place] ^ 1]))
    process = kiln.command('relight', kept.directory, '--quiet', '-o', os.path.join(kiln.scratch, 'no'))
    checks.that(process.status == harness.BAD_INPUT and 'the row of surface point' in process.stderr,
                'a damaged row: %d: %s' % (process.status, process.sentence()), process)


def main():
    _, kiln = harness.start(__doc__)
    kiln.backend = 'vulkan'
    kiln.environment['KILN_VULKAN_VALIDATION'] = os.environ.get('KILN_VULKAN_VALIDATION', '1')
    checks = harness.Checks()
    scene = room(os.path.join(kiln.scratch, 'room.glb'))
    wall = write(kiln, 'wall.yaml', WALL)
    plain = kiln.bake(scene, *OPTIONS)
    with kiln.under(KILN_DISPATCH_TIME=1):
        kept = kiln.bake(scene, *OPTIONS, '--device-memory', 0.26, '--keep-transport', 'rows')
    edited = kiln.bake(scene, *OPTIONS, '--changes', wall)
    if not all(map(checks.baked, (plain, kept, edited))):
        checks.end()
    wanted, colours = same_result.points(plain), same_result.points(edited)
    checks.that(wanted != colours, 'other colours change nothing')
    is_as(checks, kept, wanted, 'kept transport')
    traced = sum(plain.run['rays'][kind] for kind in ('bounces', 'final'))
    checks.that(kept.run['transport']['rays_kept'] == traced, 'kept: %s' % kept.run['transport'], kept.process)
    nothing = relight(kiln, checks, kept, 'nothing', environment={'KILN_GPU_FAULT': 'lost:150'})
    is_as(checks, nothing, wanted, 'nothing changed')
    if nothing is not None:
        said, backend = nothing.run['relight'], nothing.run['backend']
        checks.that(said['rays_replayed'] == traced and said['rays_traced'] == 0 and backend['recoveries'] > 0 and
                    'gather from rows' in backend['kernels'], 'relit: %s, %s' % (said, backend), nothing.process)
    is_as(checks, relight(kiln, checks, kept, 'colours', wall), colours, 'other colours')
    check_states(kiln, checks, kept, wanted, colours)
    is_near(checks, relight(kiln, checks, kept, 'embree', '--backend', 'embree'), plain, 'embree',
            'Embree from the rows of the device')
    kiln.backend = 'embree'
    other = kiln.bake(scene, *OPTIONS, '--keep-transport', 'rows')
    if checks.baked(other):
        is_near(checks, relight(kiln, checks, other, 'device', '--backend', 'vulkan'), other, 'vulkan',
                'the device from the rows of Embree')
    check_damaged(kiln, checks, kept)
    checks.end()


if __name__ == '__main__':
    main()
