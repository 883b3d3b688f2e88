"""clang-format, with the repository's .clang-format, leaves every C and C++ file as it is. Another version than 14 lays
some lines out otherwise, so the test is skipped without that one."""
import os
import re
import shutil
import subprocess
import sys
import tempfile

import tree

VERSION = 14


def find():
    """The program, or None."""
    for name in (f'clang-format-{VERSION}', 'clang-format'):
        path = shutil.which(name)
        if path:
            said = subprocess.run([path, '--version'], capture_output=True, text=True, check=True).stdout
            if re.search(rf'version {VERSION}\.', said):
                return path
    return None


def refused(program, paths):
    """What the program has against the files: its own lines, each with file and place."""
    jobs = [subprocess.Popen([program, '--dry-run', '--Werror', '--style=file', *paths[i::2]], stdin=subprocess.DEVNULL,
                             stderr=subprocess.PIPE, text=True, cwd=tree.ROOT) for i in range(2) if paths[i::2]]
    texts = [job.communicate()[1] for job in jobs]
    return [line for text in texts for line in text.splitlines() if 'error:' in line]


def main():
    program = find()
    if program is None:
        print(f'skipped: clang-format {VERSION} is not installed')
        return 77
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(os.path.join(tree.ROOT, '.clang-format'), folder)
        crooked = os.path.join(folder, 'crooked.c')
        with open(crooked, 'w', encoding='ascii') as file:
            file.write('int  f( void ){return 0;}\n')
        if not refused(program, [crooked]):
            print('clang-format has nothing against a file that is not formatted')
            return 1
    paths = [path for path in tree.tracked() if re.search(r'\.(c|h|cpp)$', path)]
    lines = refused(program, paths)
    print('\n'.join(lines))
    if lines:
        print(f'{program} -i FILE formats a file')
    return 1 if lines else 0


if __name__ == '__main__':
    sys.exit(main())
