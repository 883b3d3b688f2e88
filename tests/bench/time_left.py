"""Time left of a bake, as it is shown once a second, against what was left indeed.

  /usr/bin/python3 tests/bench/time_left.py --kiln build/release/kiln [--threads 2] [--rows 12] SCENE ... [-- OPTIONS]

A row: seconds since the begin, the share of the whole that is shown, the seconds left as shown and as they were, and
their ratio; so many rows, evenly spread. Then the share of the shown times that were within a factor of two, and the
least and largest ratio, between 10 and 90 % of the bake's time. The bar must not go back: `falls` counts how often it
did. Other work on the machine changes speeds, and so the truth.
"""
import json
import os
import shutil
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402


def watch(kiln, scene, folder, options):
    """[(seconds since the begin, share, seconds left, phase)] of a bake, and its seconds."""
    begin = time.time()
    bake = subprocess.Popen([kiln, 'bake', scene, '-o', folder, *map(str, options)], stdout=subprocess.DEVNULL,
                            stderr=subprocess.PIPE, text=True)
    seen, last = [], None
    while bake.poll() is None:
        time.sleep(0.2)
        try:
            with open(os.path.join(folder, 'checkpoint', 'status.json'), encoding='utf-8') as file:
                status = json.load(file)
        except (OSError, ValueError):
            continue
        if status['beat'] != last and status['left'] >= 0:
            seen.append((status['updated'] - begin, status['share'], status['left'], status['phase']))
        last = status['beat']
    whole = time.time() - begin
    if bake.returncode != 0:
        sys.exit(bake.stderr.read())
    return seen, whole


def report(scene, seen, whole, rows):
    print(f'{os.path.basename(scene)}: {whole:.1f} s')
    for at, share, left, phase in seen[::max(1, len(seen) // rows)]:
        print(f'{at:8.1f} s {100 * share:5.1f} %  {left:7.1f} s shown {whole - at:7.1f} s left '
              f'{left / (whole - at):6.2f}  {phase}')
    ratios = [left / (whole - at) for at, _, left, _ in seen if 0.1 * whole <= at <= 0.9 * whole]
    good = sum(0.5 <= ratio <= 2.0 for ratio in ratios) / max(1, len(ratios))
    falls = sum(b[1] < a[1] for a, b in zip(seen, seen[1:]))
    print(f'{100 * good:.0f} % within a factor of 2; {min(ratios, default=0):.2f} to {max(ratios, default=0):.2f}; '
          f'{falls} falls')


def main():
    def more(parser):
        parser.add_argument('--threads', type=int, default=2)
        parser.add_argument('--rows', type=int, default=12)
        parser.add_argument('scenes', nargs='+', metavar='SCENE')
    options = []
    if '--' in sys.argv:
        options = sys.argv[sys.argv.index('--') + 1:]
        del sys.argv[sys.argv.index('--'):]
    arguments, kiln = harness.start(__doc__, more)
    for scene in arguments.scenes:
        folder = os.path.join(kiln.scratch, os.path.basename(scene) + '-left')
        seen, whole = watch(kiln.path, scene, folder, ['--no-resume', '--threads', arguments.threads, *options])
        report(scene, seen, whole, arguments.rows)
        shutil.rmtree(folder)


if __name__ == '__main__':
    main()
