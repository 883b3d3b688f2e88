"""The hostile files, each by itself: corpus/hostile and what killers.py makes.

    replay.py --kiln PROGRAM --server FUZZ_SERVER [--only WORDS] [--step N] [--table]

Each is read by the program with sanitizers (fork_server.c), which must end with one of the statuses that will do, a
sentence and no report, within 5 s of wall-clock time (looked at again in the release build when it takes longer, for
the machine may be busy); and by the release build under strace, which must do so without opening anything outside the
folders given. Prints the longest and the largest; --table: a line for each."""
import os
import shutil
import sys
import tempfile

import killers
import mutate
import readers

MEMORY = 256 << 10  # KiB that a process may take for a hostile file


class Replay(mutate.Worker):
    def __init__(self, options, seeds):
        super().__init__(options, 0, seeds)
        self.bad, self.rows = 0, []

    def make(self, name, number):
        """As mutate.Worker's: the case of that name."""
        self.work.clean()
        made = killers.KILLERS[name][0](self.work)
        self.watch.touched()
        return made

    def one(self, name):
        arguments = self.make(name, 0)
        outcome = self.servers[arguments[0] == 'bake'].run(arguments, arguments[0] != 'bake')
        wrong = self.judge.wrongs(outcome, False)
        if outcome.kind not in ('time', 'memory'):  # else the release build tells
            wrong += self.status(name, outcome, 'with sanitizers')
        if outcome.seconds > mutate.SECONDS or outcome.kib > mutate.KIBIBYTES or outcome.kind in ('time', 'memory'):
            self.confirm(name, 0, outcome, wrong)
        if arguments[0] == 'bake' or outcome.kind != 'exit':
            arguments = self.make(name, 0)  # that has changed it
        plain = self.plain(arguments, self.options.traced > 0, 8 * mutate.SECONDS if mutate.busy_machine()
                           else mutate.PATIENCE)
        wrong += self.judge.wrongs(plain, self.options.traced > 0) + self.status(name, plain, 'the release build')
        if plain.kib > MEMORY:
            wrong.append(('much memory', '%d MiB' % (plain.kib >> 10)))
        self.rows.append((name, plain.number if plain.kind == 'exit' else plain.kind, plain.seconds, plain.cpu,
                          plain.kib >> 10, outcome.seconds, mutate.last_sentence(plain)))
        if wrong:
            self.bad += 1
            self.fail(name, 0, arguments, wrong, plain)

    @staticmethod
    def status(name, outcome, build):
        allowed = killers.KILLERS[name][1]
        if outcome.kind == 'exit' and outcome.number in allowed:
            return []
        return [('%s %d of %s instead of %s' % (outcome.kind, outcome.number, build, ' or '.join(map(str, allowed))),
                 '')]


def main():
    options = mutate.arguments((('--only', {'default': '', 'help': 'names that hold these words'}),
                                ('--step', {'type': int, 'default': 1, 'help': 'only every so-manieth'}),
                                ('--table', {'action': 'store_true'})))
    if not mutate.prepare(options):
        return 77
    with tempfile.TemporaryDirectory(prefix='kiln-fuzz-') as options.work:
        folder = os.path.join(options.work, 'seeds')
        os.makedirs(folder)
        replay = Replay(options, readers.Seeds(folder, options.kiln, {**os.environ, **mutate.MPI}))
        names = [n for n in killers.KILLERS if options.only in n][::options.step]
        for name in names:
            replay.one(name)
        replay.stop()
    for row in replay.rows if options.table else []:
        print('%-48s %4s %6.2f s %6.2f s CPU %5d MiB %6.2f s asan  %s' %
              (*row[:6], row[6].encode('ascii', 'backslashreplace').decode()[:150]))
    slow, large = max(replay.rows, key=lambda row: row[2]), max(replay.rows, key=lambda row: row[4])
    print('%d hostile files, %d failures; the longest %.2f s (%s), the largest %d MiB (%s); with sanitizers %.2f s at '
          'most' % (
        len(names), replay.bad, slow[2], slow[0], large[4], large[0], max(row[5] for row in replay.rows)))
    return 1 if replay.bad else 0


if __name__ == '__main__':
    sys.exit(main())
