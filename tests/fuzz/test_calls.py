"""What the program can not do, for it does not refer to it: start a shell, or another program by a search of PATH that
replaces it; load code by a name; listen, or talk to a network itself (MPI does).

The library of OpenMP is linked as an archive, and has a call of dlopen for devices that kiln does not use. So that
name is looked for in kiln's own object files."""
import glob
import os
import shutil
import subprocess
import unittest

SHELLS = {'system', 'popen', 'wordexp', 'execl', 'execlp', 'execle', 'execv', 'execve', 'execvp', 'execvpe', 'fexecve',
          'mktemp', 'tmpnam', 'tempnam', 'gets'}
LOADS = {'dlopen', 'dlmopen'}
NETWORK = {'socket', 'connect', 'bind', 'listen', 'accept', 'accept4', 'sendto', 'recvfrom', 'getaddrinfo',
           'gethostbyname'}


def undefined(*arguments):
    listing = subprocess.run(['nm', '--undefined-only', *arguments], capture_output=True, text=True, check=True).stdout
    return {row.split()[-1].split('@')[0] for row in listing.splitlines() if row.strip() and not row.endswith(':')}


class Calls(unittest.TestCase):
    def test_no_shell_and_no_network(self):
        if shutil.which('nm') is None:
            self.skipTest('nm is not installed.')
        names = undefined('-D', os.environ['KILN'])
        self.assertIn('posix_spawn', names)  # so that the listing is one
        self.assertEqual(names & (SHELLS | NETWORK), set())
        archives = glob.glob(os.path.join(os.path.dirname(os.environ['KILN']), 'libkiln_*.a'))
        names = undefined(*archives)
        self.assertIn('posix_spawn', names)
        self.assertEqual(names & (LOADS | SHELLS | NETWORK), set())


if __name__ == '__main__':
    unittest.main()
