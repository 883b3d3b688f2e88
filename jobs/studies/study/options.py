"""The command line of a study: its own parameters by argparse, and options of kiln, which are passed on to its
children.

`kiln --help --json` has the table of kiln's options, so that an option of a bake need not be listed here."""
import argparse
import difflib
import math
import os

from . import child
from .child import Failure

OF_ALL = ('output', 'json', 'quiet', 'verbose', 'resume')  # never passed on as they are


class Table:
    """kiln's options, commands and presets."""

    def __init__(self):
        self.all = child.kiln_json('--help')
        self.version, self.qualities = self.all['kiln'], self.all['qualities']

    def find(self, name, commands):
        """The option that one of the commands has by this name, present or former; None."""
        for option in self.all['options']:
            if name in (option['name'], option['former']) and not set(commands).isdisjoint(option['commands']):
                return option
        return None


class _Parser(argparse.ArgumentParser):
    def error(self, message):
        raise Failure(child.USAGE, message.replace('argument ', '', 1))


def number(low, high, whole=False, word=None):
    """A type for argparse: numbers in a range; `word` stands for none."""
    def read(text):
        if word is not None and text == word:
            return None
        try:
            value = int(text) if whole else float(text)
        except ValueError:
            raise argparse.ArgumentTypeError('%r is no %snumber' % (text, 'whole ' if whole else '')) from None
        if not low <= value <= high or math.isnan(value):
            raise argparse.ArgumentTypeError('%s is not from %g to %g' % (text, low, high))
        return value
    return read


def parser(study, text, arguments):
    """A parser with what all studies have. `arguments`: the names of positional ones for the usage line."""
    lines = text.strip().splitlines()
    made = _Parser(prog='kiln bench ' + study, description='\n'.join([lines[0].partition(': ')[2], *lines[1:]]),
                   usage='kiln bench %s %s [options] [options of kiln %s]' % (study, arguments, '%s'),
                   formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)
    made.add_argument('words', nargs='*', help=argparse.SUPPRESS)
    made.add_argument('-o', '--output', metavar='DIR', help='folder of the results')
    made.add_argument('--json', action='store_true', help='print one JSON object on stdout at the end')
    made.add_argument('--quiet', action='store_true', help='print errors only, no progress')
    return made


def goes_on(made):
    made.add_argument('--resume', action=argparse.BooleanOptionalAction, default=True,
                      help='continue from what the output folder has; --no-resume begins anew')


def lists(made):
    made.add_argument('--list', action='store_true', help='only list what would be baked or drawn, with the options')


class Given:
    """Options of kiln that were given: words for commands."""

    def __init__(self, table):
        self.table, self.pairs = table, []

    def has(self, name):
        return any(option['name'] == name for option, _ in self.pairs)

    def value(self, name, commands=('bake',)):
        """The last value that was given, else kiln's default, as text."""
        found = [value for option, value in self.pairs if option['name'] == name]
        return found[-1] if found else self.table.find(name, commands)['default']

    def words(self, command, without=()):
        """The options that `command` has, as words for its command line."""
        words = []
        for option, value in self.pairs:
            if command not in option['commands'] or option['name'] in without:
                continue
            if option['flag']:
                words.append('--%s%s' % ('' if value == 'true' else 'no-', option['name']))
            else:
                words += ['--' + option['name'], value]
        return words


def _is_option(word):
    """A number may begin with '-' and still be an argument."""
    return word.startswith('-') and len(word) > 1 and word[1] not in '0123456789.'


def _unknown(made, table, commands, word):
    name = word.partition('=')[0]
    known = [text for text in made._option_string_actions] + [
        '--' + o['name'] for o in table.all['options'] if not set(commands).isdisjoint(o['commands'])]
    near = difflib.get_close_matches(name, known, 1)
    return Failure(child.USAGE, '%s has no option %s%s; %s --help lists its own' % (
        made.prog, name, ', but %s' % near[0] if near else '', made.prog))


def _take(given, option, name, value, rest):
    """Notes an option of kiln; its value may be the next word."""
    if option['flag']:
        value = 'false' if name != option['name'] and name == 'no-' + option['name'] else value or 'true'
    elif value is None:
        if not rest or rest[0].startswith('--'):
            what = ': ' + option['value'] if option['value'] else ''
            raise Failure(child.USAGE, '--%s needs a value%s' % (name, what))
        value = rest.pop(0)
    given.pairs.append((option, value))


def parse(made, words, commands):
    """Parses the words behind `kiln bench NAME`: (arguments of the parser, options of kiln that `commands` have)."""
    rest, own, positional = list(words), [], []
    made.usage = made.usage % '|'.join(commands)
    if '-h' in words or '--help' in words:
        made.parse_args(['--help'])
    given = Given(Table())
    while rest:
        word = rest.pop(0)
        if word == '--':
            positional, rest = positional + rest, []
        elif not _is_option(word):
            positional.append(word)
        elif word.partition('=')[0] in made._option_string_actions:
            own.append(word)
            if made._option_string_actions[word.partition('=')[0]].nargs != 0 and '=' not in word and rest:
                own.append(rest.pop(0))
        else:
            name, has_value, value = word[2:].partition('=')
            option = given.table.find(name, commands)
            if option is None and name.startswith('no-'):
                option = given.table.find(name[3:], commands)
                option = option if option is not None and option['flag'] else None
            if option is None or not word.startswith('--') or option['name'] in OF_ALL:
                raise _unknown(made, given.table, commands, word)
            _take(given, option, name, value if has_value else None, rest)
    return made.parse_args([*own, '--', *positional]), given


def was_given(words, option):
    return any(word == option or word.startswith(option + '=') for word in words)


def check_scene(path):
    """As kiln checks it before anything else."""
    if os.path.isdir(path):
        raise Failure(child.BAD_INPUT, 'scene %s is a folder; name the .glb, .gltf or .obj file in it' % path)
    try:
        with open(path, 'rb'):
            pass
    except OSError as error:
        raise child.of_system(error, 'cannot read scene %s' % path)
    if not os.path.isfile(path):
        raise Failure(child.BAD_INPUT, 'scene %s is not a regular file' % path)


def default_output(scene, suffix):
    """The scene's name without its ending, and a suffix, in the present folder."""
    name = os.path.basename(scene)
    return ('./' if name.startswith('-') else '') + (os.path.splitext(name)[0][:240] or name) + suffix


def ascending(text, most=16):
    """Numbers of ranks, such as 1,2,4."""
    try:
        ranks = [int(part) for part in text.split(',')]
    except ValueError:
        ranks = []
    if not ranks or len(ranks) > most or ranks != sorted(set(ranks)) or not 1 <= ranks[0] <= ranks[-1] <= 65536:
        raise Failure(child.USAGE, "--ranks takes ascending numbers such as 1,2,4 (%d at most), not '%s'" % (
            most, text))
    return ranks
