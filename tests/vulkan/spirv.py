"""Shaders are valid SPIR-V for Vulkan 1.2 (spirv-val), those for ray-tracing pipelines too, which a software device
does not run: those whose names match a pattern, or all."""
import argparse
import glob
import os
import shutil
import subprocess
import sys


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--shaders', required=True, help='folder of what shaders become')
    parser.add_argument('patterns', nargs='*', default=['*'], help='of names of shaders')
    arguments = parser.parse_args()
    if shutil.which('spirv-val') is None:
        print('spirv-val is not here: it comes with spirv-tools')
        sys.exit(77)
    files = sorted({path for pattern in arguments.patterns
                    for path in glob.glob(os.path.join(arguments.shaders, pattern + '.spv'))})
    wrong = 0
    for path in files:
        done = subprocess.run(['spirv-val', '--target-env', 'vulkan1.2', '--scalar-block-layout', path],
                              capture_output=True, text=True, check=False)
        if done.returncode != 0:
            print('%s: %s' % (os.path.basename(path), done.stderr.strip()))
            wrong += 1
    print('%d shaders, of which %d are not valid' % (len(files), wrong))
    sys.exit(1 if wrong or len(files) < len(arguments.patterns) else 0)


if __name__ == '__main__':
    main()
