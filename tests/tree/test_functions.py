"""No function is longer than a page: 60 lines in C and C++, 100 in GLSL, from its first line to its last brace."""
import re
import unittest

import tree

MOST = {'c': 60, 'h': 60, 'cpp': 60, 'hpp': 60}
MOST_GLSL = 100
# What stands between the functions of a file, and ends the lines before the head of one.
BETWEEN = re.compile(r'$|[#}]|//|/\*| \*')


def functions(text):
    """(first line, lines, head) of each function. clang-format puts its braces into the first column."""
    lines = text.splitlines()
    begin = None
    for number, line in enumerate(lines):
        if line == '{':
            begin = number
            while begin > 0 and not BETWEEN.match(lines[begin - 1]):
                begin -= 1
        elif line == '}' and begin is not None:
            yield begin + 1, number - begin + 1, lines[begin]
            begin = None


def long_functions(sources):
    """Sentences on functions that are too long."""
    for path, text in sources.items():
        most = MOST_GLSL if path.startswith('shaders/') else MOST.get(path.rsplit('.', 1)[1], MOST_GLSL)
        for line, count, head in functions(text):
            if count > most:
                yield f'{path}:{line}: {count} lines, at most {most}: {head}'


class Functions(unittest.TestCase):
    def test_sources(self):
        sources = {path: tree.read(path) for path in tree.tracked()
                   if path.split('/')[0] in tree.TOPS and tree.SOURCES.search(path)}
        self.assertGreater(sum(len(list(functions(text))) for text in sources.values()), 5000)
        sentences = list(long_functions(sources))
        self.assertEqual([], sentences, '\n' + '\n'.join(sentences))

    def test_check(self):
        def text(count):
            head = '/* Adds. */\nstatic int f(int a,\n             int b)\n{\n'
            return head + '    a += b;\n' * (count - 4) + '}\n\n'
        self.assertEqual([(2, 60, 'static int f(int a,')], list(functions(text(60))))
        self.assertEqual([(2, 10, 'static int f(int a,'), (14, 61, 'static int f(int a,')],
                         list(functions(text(10) + text(61))))
        self.assertEqual([], list(long_functions({'worker/a.c': text(60), 'shaders/a.glsl': text(100)})))
        self.assertEqual(2, len(list(long_functions({'worker/a.c': text(61), 'shaders/a.glsl': text(101)}))))


if __name__ == '__main__':
    unittest.main()
