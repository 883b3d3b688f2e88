/* Tests of text from outside: control characters are written as \xNN, messages are one line, and no text is cut within
 * a character. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "worker/base/status.h"
#include "worker/base/text.h"

static const struct {
    const char *from, *to;
} cases[] = {
    {"", ""},
    {"plain, back\\slash 'quoted'", "plain, back\\slash 'quoted'"},
    {"é 你 \xf0\x9f\x95\xaf", "é 你 \xf0\x9f\x95\xaf"},
    {"\x1b[31m\r\n\t\a\x7f", "\\x1b[31m\\x0d\\x0a\\x09\\x07\\x7f"},
    {"\xc2\x9b"
     "2J",
     "\\xc2\\x9b2J"}, /* C1: a control sequence in one character */
    {"a\xe2\x80\xae"
     "b",
     "a\\xe2\\x80\\xae"
     "b"},                                                              /* right to left from here on */
    {"\xe2\x81\xa6x\xe2\x80\xa8y", "\\xe2\\x81\\xa6x\\xe2\\x80\\xa8y"}, /* an isolate, a line separator */
    /* no UTF-8 */
    {"\xff\xc3(\xc0\xaf\xed\xa0\x80\xf4\x90\x80\x80", "\\xff\\xc3(\\xc0\\xaf\\xed\\xa0\\x80\\xf4\\x90\\x80\\x80"},
    {"cut \xe4\xbd", "cut \\xe4\\xbd"},
};

static void test_plain(void **state)
{
    (void)state;
    char text[200], again[200];
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_string_equal(kiln_text_plain(text, sizeof text, cases[i].from), cases[i].to);
        assert_string_equal(kiln_text_plain(again, sizeof again, text), text);
    }
    assert_string_equal(kiln_text_plain(text, 5, "abc\xe4\xbd\xa0"), "abc");
    assert_string_equal(kiln_text_plain(text, 7, "abc\xe4\xbd\xa0"), "abc\xe4\xbd\xa0");
    assert_string_equal(kiln_text_plain(text, 6,
                                        "ab\x1b"
                                        "c"),
                        "ab");
    assert_string_equal(kiln_text_plain(text, 1, "abc"), "");
}

static void test_copies_are_cut_at_characters(void **state)
{
    (void)state;
    char text[8];
    static const char *const cut[] = {"",
                                      "",
                                      "",
                                      "",
                                      "\xf0\x9f\x95\xaf",
                                      "\xf0\x9f\x95\xaf"
                                      "a",
                                      "\xf0\x9f\x95\xaf"
                                      "a",
                                      "\xf0\x9f\x95\xaf"
                                      "a"};
    for (size_t size = 1; size <= 7; size++) {
        kiln_text_copy(text, size,
                       "\xf0\x9f\x95\xaf"
                       "a\xe4\xbd\xa0");
        assert_string_equal(text, cut[size - 1]);
    }
}

static void test_sentences_are_one_line(void **state)
{
    (void)state;
    struct kiln_error error;
    assert_int_equal(kiln_fail(&error, KILN_IO, "object '%s'", "a\nkiln: all is well\x1b[2J"), KILN_IO);
    assert_string_equal(error.message, "object 'a\\x0akiln: all is well\\x1b[2J'");
    assert_int_equal(kiln_fail_table(&error, KILN_IO, "\n  a  b", "%s", "x\ny"), KILN_IO);
    assert_string_equal(error.message, "x\\x0ay\n  a  b");
    char *longest = malloc(4096);
    assert_non_null(longest);
    for (size_t i = 0; i + 1 < 4096; i++)
        longest[i] = (char)"\xe4\xbd\xa0"[i % 3];
    longest[4095] = '\0';
    (void)kiln_fail(&error, KILN_IO, "%s", longest);
    const size_t length = strlen(error.message);
    assert_true(length >= 2044 && length % 3 == 0 && memcmp(error.message, longest, length) == 0);
    free(longest);
}

static void test_printing_keeps_only_its_own_line_feed(void **state)
{
    (void)state;
    char text[200] = "";
    FILE *file = tmpfile();
    assert_non_null(file);
    kiln_print(file, "name %s: %d\n", "a\nb\n", 3);
    kiln_print(file, "%s", "c\n");
    kiln_print(file, "%s\n", "");
    rewind(file);
    assert_int_equal(fread(text, 1, sizeof text - 1, file), 25);
    assert_string_equal(text, "name a\\x0ab\\x0a: 3\nc\\x0a\n");
    (void)fclose(file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_plain), cmocka_unit_test(test_copies_are_cut_at_characters),
        cmocka_unit_test(test_sentences_are_one_line), cmocka_unit_test(test_printing_keeps_only_its_own_line_feed)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
