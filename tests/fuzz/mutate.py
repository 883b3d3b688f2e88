"""Mutated inputs for all of kiln's readers: no crash, no hang, no access outside the folders given, less than 1 GiB, a
sentence for what is refused.

    mutate.py --kiln PROGRAM --server FUZZ_SERVER --cases 2000 --seed 1
    mutate.py ... --seed 1 --case gltf:123 --keep FOLDER      one case again, its files kept

Each case is made from a seed, the name of its reader and its number alone (readers.py, formats.py, hdf5.py). It is run
by the program with sanitizers as a fork server (fork_server.c), and one in --traced by the program itself (--kiln, a
release build) under strace. Nothing is printed of a case unless it fails; then its files, what it printed and how to
repeat it are kept in --keep, up to three of a kind.

What fails a case: a signal, a report of a sanitizer in kiln's own code, a leak (looked for in one of --leaks), a status
that says that kiln is at fault, a refusal without a sentence or with control characters in what is printed, a file that
is opened or made elsewhere, something left in TMPDIR. More than 5 s or 1 GiB with sanitizers only counts when the
release build takes as much, so that neither their cost nor a busy machine is taken for kiln's. A crash of a library in
a confined child that ends with a sentence is what the child is for, and counted by library."""
import argparse
import collections
import ctypes
import glob
import json
import multiprocessing
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zlib

import formats
import readers

SECONDS, KIBIBYTES = 5.0, 1 << 20  # what a case may take
PATIENCE = 8.0                     # s after which a case is ended
FINE = (0, 64, 65, 66, 69, 73, 74, 75, 77)
LEAK = 99
LIBRARIES = ('/usr/', '/lib/', '/lib64/', '/etc/', '/proc/', '/sys/', '/dev/null/', '/dev/urandom/', '/dev/shm/',
             '/dev/dri/', '/dev/pts/')
MPI = {'OMPI_ALLOW_RUN_AS_ROOT': '1', 'OMPI_ALLOW_RUN_AS_ROOT_CONFIRM': '1', 'OMPI_MCA_btl': 'self,vader,tcp',
       'OMPI_MCA_pml': 'ob1', 'OMPI_MCA_rmaps_base_oversubscribe': '1',
       'OMPI_MCA_hwloc_base_binding_policy': 'none', 'OMP_NUM_THREADS': '1', 'OMP_WAIT_POLICY': 'passive'}
# no threads that a fork would lose, no symbols to be looked up in each, no GPU: a driver that is unloaded again leaves
# a leak without a module's name
SANITIZERS = {'OMP_THREAD_LIMIT': '1', 'LD_BIND_NOW': '1', 'VK_ICD_FILENAMES': '/dev/null',
              'ASAN_OPTIONS': 'abort_on_error=1:symbolize=0:allocator_may_return_null=1:max_allocation_size_mb=4096:'
                               'quarantine_size_mb=8:detect_leaks=1:log_to_syslog=0',
              'UBSAN_OPTIONS': 'abort_on_error=1:print_stacktrace=1:symbolize=0',
              'LSAN_OPTIONS': 'suppressions=%s:print_suppressions=0:report_objects=0' %
              os.path.join(readers.REPOSITORY, 'tests', 'lsan.supp')}


class Watch:
    """Whether anything in a folder, or the folder itself, has been opened, changed or listed."""
    ALL = 0x0fff

    def __init__(self, folder):
        self.libc = ctypes.CDLL(None, use_errno=True)
        self.descriptor = self.libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        if self.descriptor < 0 or self.libc.inotify_add_watch(self.descriptor, folder.encode(), self.ALL) < 0:
            raise OSError(ctypes.get_errno(), 'inotify')

    def touched(self):
        """Names since the last call."""
        names = []
        while True:
            try:
                data = os.read(self.descriptor, 65536)
            except BlockingIOError:
                return names
            at = 0
            while at < len(data):
                size = int.from_bytes(data[at + 12:at + 16], 'little')
                names.append(data[at + 16:at + 16 + size].rstrip(b'\0').decode() or '(the folder)')
                at += 16 + size


class Outcome:
    def __init__(self, kind, number, seconds, cpu, kib, out, err, allocations=0):
        self.kind, self.number, self.seconds, self.cpu = kind, number, seconds, cpu
        self.kib, self.out, self.err, self.allocations = kib, out, err, allocations


class Server:
    """The program as a fork server; started again when it is lost."""

    def __init__(self, program, folder, mpi):
        self.words, self.folder, self.process = [program] + (['--mpi'] if mpi else []), folder, None

    def start(self):
        # MPI's folder of a session; servers that start together must not share one
        own = os.path.join(self.folder, 'server')
        os.makedirs(own, exist_ok=True)
        with open(os.path.join(self.folder, 'server.log'), 'ab') as log:
            self.process = subprocess.Popen(self.words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log,
                                            env={**os.environ, **MPI, **SANITIZERS, 'TMPDIR': own})

    def run(self, arguments, leaks, failing=0, patience=PATIENCE):
        """arguments: of kiln with sanitizers, or a whole command that begins with the path of another program."""
        if self.process is None:
            self.start()
        command = arguments if arguments[0].startswith('/') else ['kiln', *arguments]
        words = [str(patience), '1' if leaks else '0', str(failing), self.folder, str(len(command)), *command]
        self.process.stdin.write(b''.join(w.encode('utf-8', 'surrogateescape') + b'\0' for w in words))
        self.process.stdin.flush()
        answer = self.process.stdout.readline().split()
        if len(answer) != 6:
            sys.exit('the fork server ended: %s' %
                     readers.read(os.path.join(self.folder, 'server.log')).decode(errors='replace')[-2000:])
        return Outcome(answer[0].decode(), int(answer[1]), float(answer[2]), float(answer[3]), int(answer[4]),
                       *printed(self.folder), int(answer[5]))

    def stop(self):
        if self.process is not None:
            self.process.stdin.close()
            self.process.wait()


def printed(folder):
    texts = []
    for name in ('out', 'err'):
        with open(os.path.join(folder, name), 'rb') as file:
            texts.append(file.read(1 << 20))
    return texts


def busy_machine():
    return os.getloadavg()[0] > 1.5 * os.cpu_count()


# ---- judging ----

FRAME = re.compile(r'#\d+ 0x[0-9a-f]+ .*?\(?(/[^ ()+]+)\+(0x[0-9a-f]+)\)')
CONTROL = re.compile('[\x00-\x08\x0b-\x1f\x7f\u0080-\u009f]')
RUNTIME = ('libasan', 'libubsan', 'libclang_rt', 'libc.so', 'libc-', 'libstdc++', 'libpthread', 'libm.so', 'ld-linux',
           'libgcc')


def blamed(err):
    """The first file in a sanitizer's report that is no run-time library, and the addresses of that file."""
    text = err.decode(errors='replace')
    start = max(text.find('AddressSanitizer'), text.find('runtime error:'), 0)
    frames = [f for f in FRAME.findall(text[start:]) if not os.path.basename(f[0]).startswith(RUNTIME)]
    if not frames:
        return None, []
    return os.path.basename(frames[0][0]), [f[1] for f in frames if f[0] == frames[0][0]][:6]


def has_report(err):
    return b'ERROR: AddressSanitizer' in err or b'runtime error:' in err


def is_ours(server, module):
    return module is None or module == os.path.basename(server)


def last_sentence(outcome):
    rows = [row for row in outcome.err.decode('utf-8', 'replace').split('\n') if row.startswith('kiln: ')]
    return rows[-1] if rows else ''


def general(text):
    """A sentence without what is special to a case, to tell kinds apart."""
    return re.sub(r"'[^']*'|\S*/\S*|\d[\d.e+]*", '_', text)[:100]


class Judge:
    def __init__(self, options, work, watch):
        self.options, self.work, self.watch = options, work, watch

    def wrongs(self, outcome, traced):
        """(kind, details) of all that is wrong with it."""
        found = []
        if outcome.kind == 'signal':
            module, places = blamed(outcome.err)
            found.append(('signal %d' % outcome.number, '%s %s' % (module, ' '.join(places[:3]))))
        elif has_report(outcome.err):
            module, places = blamed(outcome.err)
            if is_ours(self.options.server, module):
                found.append(('a report in a confined child', '%s %s' % (module, ' '.join(places[:3]))))
        if outcome.kind == 'exit' and outcome.number == LEAK:
            found.append(('a leak', ' '.join(blamed(outcome.err[outcome.err.find(b'leak of'):])[1])))
        elif outcome.kind == 'exit' and outcome.number not in FINE:
            found.append(('status %d' % outcome.number, general(last_sentence(outcome))))
        if outcome.kind == 'exit' and outcome.number not in (0, LEAK) and len(last_sentence(outcome).split()) < 5:
            found.append(('no sentence', repr(outcome.err[-200:])))
        if not has_report(outcome.err) and outcome.number != LEAK:
            for name, text in (('out', outcome.out), ('err', outcome.err)):
                control = CONTROL.search(text.decode('utf-8', 'replace'))
                if control:
                    found.append(('a control character in std' + name, 'U+%04X' % ord(control.group())))
        touched = self.watch.touched()
        if touched:
            found.append(('an access outside the folders', ' '.join(sorted(set(touched)))))
        left = os.listdir(os.path.join(self.work.folder, 'tmp'))
        if left and outcome.kind == 'exit':
            found.append(('left in TMPDIR', ' '.join(general(name) for name in left)))
        return found + (self.opened() if traced else [])

    def opened(self):
        """What strace saw opened or made elsewhere."""
        path = os.path.join(self.work.folder, 'calls')
        own = (self.work.folder + '/', self.work.seeds.folder, self.options.kiln)
        found = set()
        with open(path, errors='replace') as file:
            for row in file:
                call = re.match(r'\d+ +(\w+)\(', row)
                if call is None or not re.search(r'= (\d+)(<.*>)?$', row.rstrip()):
                    continue
                name = re.search(r'= \d+<(.*)>$', row.rstrip())
                target = name.group(1) if name else (re.findall(r'"((?:[^"\\]|\\.)*)"', row) or [''])[-1]
                if not target.startswith('/') or target == '/':
                    continue
                changes = call.group(1) not in ('open', 'openat',
                                                'openat2') or re.search(r'O_(WRONLY|RDWR|CREAT|TRUNC)', row)
                allowed = own + (() if changes and not target.startswith(('/dev/', '/proc/')) else LIBRARIES)
                if (target.startswith(self.work.outside) or not (target + '/').startswith(allowed)
                        or target.startswith(('/etc/passwd', '/dev/zero'))):
                    found.add('%s %s' % (call.group(1), target))
        return [('an access outside the folders (strace)', ' '.join(sorted(found)))] if found else []


# ---- one worker ----

def blank():
    return {'cases': 0, 'refused': 0, 'taken': 0, 'stopped': 0, 'contained': collections.Counter(), 'slow': 0,
            'large': 0, 'worst': 0.0, 'most': 0, 'traced': 0, 'leaks': 0, 'times': [], 'slowest': []}


class Worker:
    def __init__(self, options, number, seeds):
        self.options, self.number = options, number
        self.folder = os.path.join(options.work, 'worker%d' % number)
        os.makedirs(self.folder, exist_ok=True)
        self.work = readers.Work(self.folder, seeds)
        self.watch = Watch(self.work.outside)
        self.judge = Judge(options, self.work, self.watch)
        self.servers = {mpi: Server(options.server, self.folder, mpi) for mpi in (False, True)}
        self.table = collections.defaultdict(blank)
        self.failures, self.kept = [], collections.Counter()

    def make(self, name, number):
        r = random.Random('%s %s %d' % (self.options.seed, name, number))
        self.work.clean()
        formats.OUTSIDE[:] = self.work.references
        arguments = readers.READERS[name][1](r, self.work)
        self.watch.touched()  # what making it did
        return arguments

    def chosen(self, what, name, number):
        """Whether the case is one of those in so many."""
        share = getattr(self.options, what)
        return share > 0 and zlib.crc32(b'%s %s %d' % (what.encode(), name.encode(), number)) % share == 0

    def run(self, arguments, name, number):
        """The outcome, and whether it was traced."""
        if self.chosen('traced', name, number):
            return self.plain(arguments, True), True
        if name in readers.PLAIN:
            return self.plain(arguments, False), False
        mpi = arguments[0] in ('bake', 'relight', 'mix')
        return self.servers[mpi].run(arguments, not mpi and self.chosen('leaks', name, number)), False  # MPI leaks

    def plain(self, arguments, traced, patience=PATIENCE):
        """The release build."""
        return self.servers[False].run((self.strace() if traced else []) + [self.options.kiln, *arguments], False, 0,
                                       patience)

    def strace(self):
        calls = ('trace=open,openat,openat2,creat,unlink,unlinkat,rename,renameat,renameat2,mkdir,mkdirat,rmdir,link,'
                 'linkat,symlink,symlinkat,truncate,connect')
        return [shutil.which('strace'), '--seccomp-bpf', '-f', '-qq', '-y', '-s', '5000', '-o',
                os.path.join(self.folder, 'calls'), '-e', calls]

    def confirm(self, name, number, outcome, wrong):
        """Over the limits with sanitizers or under strace: what does the release build say?"""
        row = self.table[name]
        busy = busy_machine()  # then processor time is what counts, unless there is no end
        again = self.plain(self.make(name, number), False, 8 * SECONDS if busy else PATIENCE)
        if outcome.seconds > SECONDS:
            row['slow'] += 1
            if again.kind == 'time' or (again.cpu if busy else again.seconds) > SECONDS:
                wrong.append(('more than %g s' % SECONDS, '%s; %s' %
                              ('busy' if again.cpu > 0.5 * SECONDS else 'waiting', general(last_sentence(again)))))
        if outcome.kib > KIBIBYTES or outcome.kind == 'memory':
            row['large'] += 1
            if again.kib > KIBIBYTES:
                wrong.append(('more than 1 GiB', general(last_sentence(again))))
        if again.kind == 'signal':
            wrong.append(('signal %d of the release build' % again.number, general(last_sentence(again))))
        self.watch.touched()

    def case(self, name, number):
        try:
            arguments = self.make(name, number)
        except Exception as reason:
            raise RuntimeError('the case %s:%d of seed %s cannot be made' %
                               (name, number, self.options.seed)) from reason
        outcome, traced = self.run(arguments, name, number)
        wrong = self.judge.wrongs(outcome, traced)
        if outcome.seconds > SECONDS or outcome.kib > KIBIBYTES or outcome.kind in ('time', 'memory'):
            self.confirm(name, number, outcome, wrong)
        self.count(name, number, outcome, traced)
        if wrong or self.options.keep_all:
            self.fail(name, number, arguments, wrong, outcome)
        return wrong

    def count(self, name, number, outcome, traced):
        row = self.table[name]
        row['cases'] += 1
        row['traced'] += traced
        row['worst'], row['most'] = max(row['worst'], outcome.seconds), max(row['most'], outcome.kib)
        row['times'].append(outcome.seconds)
        row['slowest'] = sorted(row['slowest'] + [(outcome.seconds, '%s:%d' % (name, number))])[-5:]
        if outcome.kind == 'exit':
            row['taken' if outcome.number == 0 else 'stopped' if outcome.number == 75 else 'refused'] += 1
        if outcome.kind == 'exit' and (has_report(outcome.err) or b' died (' in outcome.err):
            module = blamed(outcome.err)[0] if has_report(outcome.err) else 'by a limit or signal'
            row['contained'][module or 'unknown'] += 1

    def fail(self, name, number, arguments, wrong, outcome):
        kind = '%s: %s' % (name, '; '.join('%s (%s)' % w for w in wrong))
        self.failures.append(kind)
        self.kept[kind] += 1
        if self.kept[kind] > 3 or len(self.kept) > 200:
            return
        target = os.path.join(self.options.keep, '%s-%s-%d' % (self.options.seed, name.replace(' ', '_'), number))
        shutil.rmtree(target, ignore_errors=True)
        os.makedirs(target, exist_ok=True)
        copy_case(self.work.case, os.path.join(target, 'case'))
        readers.write(os.path.join(target, 'out'), outcome.out)
        readers.write(os.path.join(target, 'err'), outcome.err)
        again = 'tests/fuzz/mutate.py --seed %s --case "%s:%d" --kiln %s --server %s' % (
            self.options.seed, name, number, self.options.kiln, self.options.server)
        with open(os.path.join(target, 'verdict'), 'w', encoding='utf-8', errors='replace') as file:
            file.write('%s\n%s %d after %.2f s, %.2f s of CPU, %d KiB\ncommand: kiln %s\nagain: %s\n' %
                       (kind, outcome.kind, outcome.number, outcome.seconds, outcome.cpu, outcome.kib,
                        ' '.join(arguments).replace(self.folder + '/', ''), again))
        if wrong:
            print('FAIL %s\n     %s; files in %s\n     again: %s' %
                  (kind.encode('ascii', 'backslashreplace').decode(),
                   last_sentence(outcome).encode('ascii', 'backslashreplace').decode()[:300], target, again),
                  flush=True)

    def stop(self):
        for server in self.servers.values():
            server.stop()


def copy_case(source, target):
    """FIFOs and links as they are."""
    os.makedirs(target, exist_ok=True)
    for entry in os.scandir(source):
        to = os.path.join(target, entry.name)
        if entry.is_symlink():
            os.symlink(os.readlink(entry.path), to)
        elif entry.is_dir():
            copy_case(entry.path, to)
        elif entry.is_file():
            shutil.copy(entry.path, to)
        else:
            os.mkfifo(to)


def work_through(options, number, seeds, cases, results):
    worker = Worker(options, number, seeds)
    start = said = time.monotonic()
    try:
        for i, (name, case) in enumerate(cases):
            worker.case(name, case)
            if number == 0 and time.monotonic() - said > options.every:
                said = time.monotonic()
                rate = (i + 1) / (said - start)
                print('%d of %d cases each, %.0f a second in all, %d failures here, %.0f s left' %
                      (i + 1, len(cases), rate * options.jobs, len(worker.failures), (len(cases) - i) / rate),
                      flush=True)
        results.put((number, dict(worker.table), worker.failures, None))
    except BaseException as reason:  # told by the parent
        results.put((number, dict(worker.table), worker.failures,
                     repr(reason) + (' from ' + repr(reason.__cause__) if reason.__cause__ else '')))
        raise
    finally:
        worker.stop()


# ---- all of them ----

def plan(options):
    """(reader, number) of all cases, readers mixed in proportion to their shares, so that the run may be cut short."""
    names = options.readers.split(',') if options.readers else list(readers.READERS)
    total = sum(readers.READERS[n][0] for n in names)
    cases = []
    for name in names:
        count = max(1, round(options.cases * readers.READERS[name][0] / total))
        cases += [((i + 0.5) / count, name, i) for i in range(count)]
    return [(name, options.first + i) for _, name, i in sorted(cases)]


def merged(tables):
    table = collections.defaultdict(blank)
    for part in tables:
        for name, row in part.items():
            mine = table[name]
            for key, value in row.items():
                if key in ('worst', 'most'):
                    mine[key] = max(mine[key], value)
                else:
                    mine[key] += value
    return table


def print_table(table):
    print('\n| reader | cases | taken | refused | stopped | mean, s | 99 % within, s | longest, s | most memory, MiB '
          '| contained crashes |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |')
    rows = [(name, table[name]) for name in readers.READERS if name in table]
    total = merged([{'all': row} for _, row in rows])['all']
    for name, row in rows + [('all', total)]:
        times = sorted(row['times'])
        inside = ', '.join('%s %d' % pair for pair in sorted(row['contained'].items())) or '0'
        print('| %s | %d | %d | %d | %d | %.3f | %.2f | %.2f | %d | %s |' %
              (name, row['cases'], row['taken'], row['refused'], row['stopped'], sum(times) / max(1, len(times)),
               times[int(0.99 * (len(times) - 1))] if times else 0,
                                                             row['worst'], row['most'] >> 10, inside))
    print('\nThe longest: %s.' %
          ', '.join('%s %.1f s' % (name, seconds) for seconds, name in sorted(total['slowest'])[:-6:-1]))
    print('With sanitizers %d took more than %g s and %d more than 1 GiB; %d ran under strace.' %
          (total['slow'], SECONDS, total['large'], total['traced']))


def run_all(options, seeds):
    cases = plan(options)
    results, start = multiprocessing.SimpleQueue(), time.monotonic()
    processes = [multiprocessing.Process(target=work_through, args=(options, j, seeds, cases[j::options.jobs],
                                                                    results)) for j in range(options.jobs)]
    for process in processes:
        process.start()
    ended = [results.get() for _ in processes]
    for process in processes:
        process.join()
    seconds = time.monotonic() - start
    table = merged([part for _, part, _, _ in ended])
    failures = collections.Counter(f for _, _, some, _ in ended for f in some)
    broken = [reason for _, _, _, reason in ended if reason]
    print_table(table)
    print('%d cases of seed %s in %.0f s, %.0f a second by %d processes; %d failures of %d kinds' %
          (len(cases), options.seed, seconds, len(cases) / seconds, options.jobs, sum(failures.values()),
           len(failures)))
    for kind, count in failures.most_common():
        print('%6d  %s' % (count, kind.encode('ascii', 'backslashreplace').decode()))
    for reason in broken:
        print('a worker ended: %s' % reason)
    return 1 if failures or broken else 0


def run_one(options, seeds):
    name, number = options.case.rsplit(':', 1)
    options.keep_all, worker = True, Worker(options, 0, seeds)
    wrong = worker.case(name, int(number))
    worker.stop()
    print(readers.read(glob.glob(os.path.join(options.keep, '*', 'verdict'))[-1]).decode(errors='replace'))
    print(worker.judge and readers.read(os.path.join(worker.folder, 'err')).decode(errors='replace')[-3000:])
    return 1 if wrong else 0


def arguments(more=()):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--kiln', default=os.environ.get('KILN'), help='the program, a release build')
    parser.add_argument('--server',
                        default=os.environ.get('KILN_FUZZ_SERVER',
                                               os.path.join(readers.REPOSITORY, 'build', 'asan', 'tests',
                                                            'fuzz_server')))
    parser.add_argument('--seed', default=os.environ.get('KILN_SEED', '1'))
    parser.add_argument('--cases', type=int, default=int(os.environ.get('KILN_CASES', '2000')))
    parser.add_argument('--first', type=int, default=0,
                        help='number of each reader\'s first case, to go on where a run was cut short')
    parser.add_argument('--readers', default='', help='of ' + ', '.join(readers.READERS))
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--traced', type=int, default=50,
                        help='one case in so many runs in the release build under strace; 0: none')
    parser.add_argument('--leaks', type=int, default=16, help='leaks are looked for in one case of so many; 0: in none')
    parser.add_argument('--every', type=float, default=60, help='seconds between lines of progress')
    parser.add_argument('--case', help='READER:NUMBER, only this one')
    parser.add_argument('--keep', help='where failing cases are kept (a new temporary folder)')
    for name, how in more:
        parser.add_argument(name, **how)
    return parser.parse_args()


def prepare(options):
    """Completes the options; False: skipped, and said why."""
    if not options.kiln or not os.access(options.kiln, os.X_OK) or not os.access(options.server, os.X_OK):
        print('skipped: %s or %s is not built.' % (options.kiln, options.server))
        return False
    options.kiln, options.server = os.path.abspath(options.kiln), os.path.abspath(options.server)
    if options.traced and shutil.which('strace') is None:
        print('strace is not installed: only the watched folder tells of accesses elsewhere')
        options.traced = 0
    options.keep, options.keep_all = options.keep or os.path.join(tempfile.gettempdir(),
                                                                  'kiln-fuzz-failures-%d' % os.getpid()), False
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    return True


def main():
    options = arguments()
    if not prepare(options):
        return 77
    print('seed %s' % options.seed, flush=True)
    with tempfile.TemporaryDirectory(prefix='kiln-fuzz-') as options.work:
        seeds = os.path.join(options.work, 'seeds')
        os.makedirs(seeds)
        seeds = readers.Seeds(seeds, options.kiln, {**os.environ, **MPI})
        return run_one(options, seeds) if options.case else run_all(options, seeds)


if __name__ == '__main__':
    sys.exit(main())
