"""Every malformed scene of ../shared/scenes/own/bad, read by the program with sanitizers as a fork server: status 65,
one sentence that names the file, no report and no leak.

    bad_scenes.py --kiln PROGRAM --server FUZZ_SERVER

tests/import/test_bad.py asks the same of the release build, and of each program with sanitizers started anew."""
import json
import os
import sys
import tempfile

import mutate
import readers

BAD = os.path.normpath(os.path.join(readers.REPOSITORY, '..', 'shared', 'scenes', 'own', 'bad'))


def wrongs(worker, name):
    """All that is wrong with the answer to that scene."""
    worker.work.clean()
    worker.watch.touched()
    outcome = worker.servers[False].run(['info', os.path.join(BAD, name)], True)
    found = ['%s: %s' % pair for pair in worker.judge.wrongs(outcome, False)]
    if outcome.kind != 'exit' or outcome.number != 65:
        found.append('%s %d instead of 65' % (outcome.kind, outcome.number))
    said = [row for row in outcome.err.decode('utf-8', 'replace').split('\n') if row.startswith('kiln: error: ')]
    if len(said) != 1 or name[:60] not in said[0] or outcome.out:
        found.append('not one sentence that names the file: %r' % outcome.err[-500:])
    return found


def main():
    options = mutate.arguments()
    if not mutate.prepare(options):
        return 77
    if not os.path.exists(BAD):
        print('skipped: ../shared/scenes/own/bad is not here')
        return 77
    with open(os.path.join(BAD, 'index.json')) as file:
        names = sorted(json.load(file))
    bad = 0
    with tempfile.TemporaryDirectory(prefix='kiln-fuzz-') as options.work:
        folder = os.path.join(options.work, 'seeds')
        os.makedirs(folder)
        worker = mutate.Worker(options, 0, readers.Seeds(folder, options.kiln, {**os.environ, **mutate.MPI}))
        for name in names:
            found = wrongs(worker, name)
            bad += bool(found)
            for each in found:
                print('%s: %s' % (name, each))
        worker.stop()
    print('%d broken scenes, %d failures' % (len(names), bad))
    return 1 if bad or len(names) <= 60 else 0


if __name__ == '__main__':
    sys.exit(main())
