"""The folder of a study's results: its mark and its lock, as every command of kiln has them, files that are whole or
not there, and the results from which the same command goes on."""
import fcntl
import hashlib
import json
import os
import socket
import struct
import time

from . import child
from .child import Failure

MARK, LOCK = '.kiln.unfinished', '.kiln.lock'


def publish(path, data):
    """Writes a file under a temporary name beside it, and renames it."""
    folder, name = os.path.split(path)
    part = os.path.join(folder, '.%s.part' % name)
    try:
        with open(part, 'wb') as file:
            file.write(data if isinstance(data, bytes) else data.encode())
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    except OSError as error:
        raise child.of_system(error, "'%s' cannot be written" % path, child.INPUT_OUTPUT)
    finally:
        child.remove(part)


def _text(path):
    try:
        with open(path) as file:
            return file.read().strip()
    except OSError:
        return ''


def _is_temporary(name):
    return name.startswith(LOCK) or name in (MARK, '.%s.part' % MARK)


class Folder:
    """DIR, which belongs to the study alone as long as it runs. `results`: files of which one says that the study has
    ended there before. A context: what is left of it when it ends with a failure goes on with the same command."""

    def __init__(self, path, study, results):
        self.path, self.owner, self.results = path, 'kiln bench ' + study, results
        self.lock = None

    def __enter__(self):
        self.made = not os.path.exists(self.path)
        try:
            os.makedirs(self.path, exist_ok=True)
        except OSError as error:
            raise child.of_system(error, 'cannot make the folder %s' % self.path, child.CANNOT_CREATE)
        self.marked = False
        try:
            self._take()
            self._mark()
        except BaseException:
            self.__exit__(Failure, None, None)
            raise
        return self

    def __exit__(self, kind, *_):
        others = [name for name in os.listdir(self.path) if not _is_temporary(name)]
        if self.marked and (kind is None or not others):
            child.remove(os.path.join(self.path, MARK))
        if self.lock is not None:
            child.remove(os.path.join(self.path, LOCK))
            os.close(self.lock)
        if self.made:
            try:
                os.rmdir(self.path)
            except OSError:
                pass  # it has results

    def _mark(self):
        owner = _text(os.path.join(self.path, MARK))
        if owner == self.owner:
            self._sweep()
        elif any(not _is_temporary(name) for name in os.listdir(self.path)) and (
                owner or not any(os.path.isfile(os.path.join(self.path, name)) for name in self.results)):
            if owner:
                raise Failure(child.USAGE, "%s has files of '%s', which has not ended: give '%s' another folder with -o"
                              % (self.path, owner, self.owner))
            raise Failure(child.USAGE, "%s has other files in it: give a folder with -o that is new, is empty, or has "
                                       "what '%s' has written before" % (self.path, self.owner))
        publish(os.path.join(self.path, MARK), self.owner + '\n')
        self.marked = True

    def _sweep(self):
        """Removes temporary files of a killed process."""
        for folder, _, names in os.walk(self.path):
            for name in names:
                if name.startswith('.') and name.endswith('.part'):
                    child.remove(os.path.join(folder, name))

    # ---- the lock: coordinator/run/lock.h of kiln's sources ----

    def _describe(self):
        with open('/proc/self/stat', 'rb') as file:
            started = int(file.read().rpartition(b')')[2].split()[19])
        return json.dumps({'host': socket.gethostname(), 'boot': _text('/proc/sys/kernel/random/boot_id'),
                           'process': os.getpid(), 'started': started, 'since': int(time.time()),
                           'command': _text('/proc/self/cmdline').replace('\0', ' ').strip()[:190], 'locks': True})

    def _take(self):
        """Locks DIR/.kiln.lock. Without locks in the file system two studies are not told apart."""
        path = os.path.join(self.path, LOCK)
        for _ in range(20):
            try:
                descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
            except OSError as error:
                raise child.of_system(error, "'%s' cannot be created" % path, child.CANNOT_CREATE)
            try:
                fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, struct.pack('hhqqi4x', fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0))
            except BlockingIOError:
                os.close(descriptor)
                self._refuse(path)
            except OSError:
                pass
            try:
                if os.path.samestat(os.fstat(descriptor), os.stat(path)):
                    break
            except FileNotFoundError:
                pass
            os.close(descriptor)  # of a holder that has just ended
        self.lock = descriptor
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, self._describe().encode(), 0)

    def _refuse(self, path):
        try:
            holder = json.loads(_text(path))
        except ValueError:
            holder = {}
        raise Failure(child.CANNOT_CREATE, 'another command is at work in %s (process %s on %s: %s): wait for it, or '
                                           'choose another folder' % (self.path, holder.get('process', '?'),
                                                                      holder.get('host', '?'),
                                                                      holder.get('command', '?')))


class Kept:
    """NAME.json in the folder: what the study goes on from, with the identity of what it holds for. Its last line is
    the hash of all before."""

    def __init__(self, folder, study, identity, resume, empty):
        self.path = os.path.join(folder, study + '.json')
        self.values = self._read(resume) or {'identity': identity, **empty}
        if self.values['identity'] != identity:
            raise Failure(child.BAD_INPUT, "'%s' has results of another scene, by another kiln or with other options; "
                                           "give another --output, or --no-resume to begin anew" % folder)

    def _read(self, resume):
        if not resume or not os.path.exists(self.path):
            return None
        with open(self.path, 'rb') as file:
            text, _, tail = file.read().rstrip(b'\n').rpartition(b'\n')
        if tail != self._tail(text + b'\n').rstrip(b'\n'):
            raise Failure(child.BAD_INPUT, "'%s' is damaged, or of an older kiln; --no-resume begins anew, another "
                                           "--output keeps it" % self.path)
        return json.loads(text)

    @staticmethod
    def _tail(text):
        return b'sha256 ' + hashlib.sha256(text).hexdigest().encode() + b'\n'

    def write(self):
        text = json.dumps(self.values, indent=1, sort_keys=True).encode() + b'\n'
        publish(self.path, text + self._tail(text))


def identity(given, scene, reference=None, reference_samples=None):
    """The identity of results: the scene, the options of bakes, and where the reference is from."""
    own = ('checkpoint-every', 'watchdog')
    options = {option['name']: value for option, value in given.pairs
               if 'bake' in option['commands'] and option['name'] not in own and option['group'] != 'Messages'}
    return {'kiln': given.table.version, 'scene': scene, 'options': options, 'reference': reference or '',
            'reference_samples': 0 if reference else reference_samples}
