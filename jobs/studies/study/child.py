"""Running kiln, and ending as kiln does: one sentence on stderr, an exit code of kiln's, an object on stdout with
--json. """
import importlib.util
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback

USAGE, BAD_INPUT, NO_INPUT, BUG, SYSTEM, CANNOT_CREATE, INPUT_OUTPUT, STOPPED, PERMISSION, SITE = (
    64, 65, 66, 70, 71, 73, 74, 75, 77, 78)
PACKAGES = {'numpy': 'python3-numpy', 'matplotlib': 'python3-matplotlib', 'h5py': 'python3-h5py'}


class Failure(Exception):
    """Ends the study with this exit code and this sentence."""

    def __init__(self, code, sentence):
        super().__init__(sentence)
        self.code, self.sentence = code, sentence


def of_system(error, sentence, code=None):
    """The failure of a call of the operating system."""
    codes = {FileNotFoundError: NO_INPUT, NotADirectoryError: NO_INPUT, PermissionError: PERMISSION}
    return Failure(code or codes.get(type(error), INPUT_OUTPUT), '%s: %s' % (sentence, error.strerror))


def need(*modules):
    """Python modules that the study uses, and that not every Python has."""
    for name in modules:
        if importlib.util.find_spec(name) is None:
            raise Failure(SITE, "the study needs Python's %s, which %s lacks: install %s, or name an interpreter that "
                                "has it in KILN_PYTHON" % (name, sys.executable, PACKAGES[name]))


# ---- signals ----

class _State:
    child = None  # the process that runs
    asked = 0  # the last signal that asked for the end


def _end(number, _):
    """A child is asked to end, and the study ends when it has; without one the study ends at once."""
    first, _State.asked = _State.asked == 0, number
    if _State.child is not None:
        _State.child.send_signal(signal.SIGTERM if number == signal.SIGHUP else number)
    elif first:
        _stop()


def _stop():
    raise Failure(STOPPED, 'stopped by %s; run the same command again' % signal.Signals(_State.asked).name)


def _catch():
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _end)


# ---- children ----

class Done:
    """A command that has ended: its exit code, what it printed, and what it took in seconds."""

    def __init__(self, code, out, said, seconds, processor):
        self.code, self.out, self.said, self.seconds, self.processor = code, out, said, seconds, processor

    def sentence(self):
        """The sentence with which it failed; all that it wrote to stderr if there is none."""
        return self.said.partition('kiln: error: ')[2] or self.said

    def must(self, what):
        """The failure of the command is that of the study."""
        if self.code != 0:
            raise Failure(self.code if USAGE <= self.code <= SITE else SYSTEM,
                          '%s failed with %d: %s' % (what, self.code, self.sentence()[:900].rstrip('\n')))
        return self

    def json(self):
        return json.loads(self.out)


def _processor():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run(command, limit=None):
    """Runs a command to its end. Signals that ask the study to end are passed on to it."""
    environment = dict(os.environ, KILN_ENDS_WITH=str(os.getpid()))  # kiln's children die with this process
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as said:
        begin, before = time.monotonic(), _processor()
        try:
            _State.child = subprocess.Popen([str(word) for word in command], stdin=subprocess.DEVNULL, stdout=out,
                                            stderr=said, env=environment)
        except OSError as error:
            raise of_system(error, '%s cannot be started%s' % (
                command[0], '; is Open MPI in PATH?' if command[0] == 'mpirun' else ''), SITE)
        code = _State.child.wait(limit)
        seconds, processor = time.monotonic() - begin, _processor() - before
        _State.child = None
        if _State.asked:
            _stop()
        out.seek(0), said.seek(0)
        return Done(code, out.read().decode('utf-8', 'replace'), said.read().decode('utf-8', 'replace'), seconds,
                    processor)


def kiln(*words, ranks=0):
    """Runs kiln; with ranks under mpirun."""
    return run([*(['mpirun', '-n', ranks] if ranks else []), os.environ['KILN'], *words])


def kiln_json(*words):
    """The object that a command of kiln prints."""
    return kiln(*words, '--json').must('kiln %s' % words[0]).json()


def report(folder):
    """The run.json of a bake."""
    path = os.path.join(folder, 'run.json')
    try:
        with open(path) as file:
            return json.load(file)
    except OSError as error:
        raise of_system(error, "'%s' cannot be read" % path)
    except ValueError as error:
        raise Failure(BAD_INPUT, "'%s' cannot be read: %s" % (path, error))


def remove(path):
    """A file, or a folder with all that is in it."""
    if os.path.isdir(path) and not os.path.islink(path):
        shutil.rmtree(path, ignore_errors=True)
    elif os.path.lexists(path):
        os.remove(path)


# ---- the program ----

def tell(quiet, sentence):
    """Progress, on stderr."""
    if not quiet:
        print('kiln: ' + sentence, file=sys.stderr, flush=True)


def show_json(values):
    print(json.dumps(values, separators=(',', ':')), flush=True)


def main(study, *modules):
    """Runs study() and ends the process. It uses numpy, and these modules."""
    failure, code = None, 0
    try:
        _catch()
        need('numpy', *modules)
        if 'KILN' not in os.environ:
            raise Failure(USAGE, "the study has no program to run: start it by 'kiln bench', or name one in KILN")
        study()
        sys.stdout.flush()
    except Failure as found:
        failure = found
    except BrokenPipeError:
        failure = Failure(INPUT_OUTPUT, 'stdout cannot be written: Broken pipe')
    except OSError as error:
        failure = of_system(error, error.filename or 'a file')
    except MemoryError:
        failure = Failure(SYSTEM, 'out of memory')
    except Exception as error:
        traceback.print_exc()
        failure = Failure(BUG, 'the study has a bug: %s: %s' % (type(error).__name__, error))
    if failure is not None:
        code, stopped = failure.code, failure.code == STOPPED
        print('kiln: %s%s' % ('' if stopped else 'error: ', failure.sentence), file=sys.stderr, flush=True)
        if '--json' in sys.argv and not getattr(failure, 'answered', False):
            show_json({'status': 'stopped' if stopped else 'error', 'code': code, 'message': failure.sentence})
    try:
        sys.stdout.flush()
    finally:
        os._exit(code)  # whatever is still buffered for a pipe that nobody reads
