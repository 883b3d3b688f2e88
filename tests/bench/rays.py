"""Rays per second of the bounce pass against Embree alone on the same rays: `kiln bench rays` on Cornell box and
Sponza.

  /usr/bin/python3 tests/bench/rays.py --kiln build/release/kiln

The aim is 0.80 in both. Sponza is third-party and is left out where ../shared is absent.
"""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402


def main():
    _, kiln = harness.start(__doc__)
    scenes = [('Cornell box', measure.made(kiln, 'cornell'), 0.80)]
    sponza = os.path.join(harness.SHARED, 'third_party', 'crytek_sponza.glb')
    if os.path.exists(sponza):
        scenes.append(('Sponza', sponza, 0.80))
    else:
        print('Sponza is left out: ../shared/scenes/third_party is not here.')
    for name, path, aim in scenes:
        p = kiln.command('bench', 'rays', path, '--json', '--quiet', timeout=1800)
        if p.status != 0:
            sys.exit('%s\nended with %d: %s' % (p.line(), p.status, p.sentence()))
        print('%s: share of Embree alone %.2f (aim %.2f)\n%s' % (name, p.json()['share'], aim, p.stdout.strip()))


if __name__ == '__main__':
    main()
