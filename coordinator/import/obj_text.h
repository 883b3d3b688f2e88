/* A reader of OBJ and MTL text, line by line and word by word, in the mapped file. Private to
 * coordinator/import/obj*.c.
 *
 * A line ends with LF or CR LF. A backslash before its end continues it. '#' begins a comment. Words are separated by
 * blanks and tabs. The decimal separator is a point, whatever the locale. */
#ifndef KILN_COORDINATOR_IMPORT_OBJ_TEXT_H
#define KILN_COORDINATOR_IMPORT_OBJ_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/import/confine.h"

struct obj_text {
    const char *scene, *name; /* begin error sentences; name is empty for the scene's own file; borrowed */
    const unsigned char *at, *end;
    uint64_t line;
    struct kiln_error *error;
    unsigned char *owned; /* the text converted from UTF-16, or NULL */
};

/* A word: bytes of the text, not NUL-terminated. */
struct obj_word {
    const char *text;
    size_t length;
};

/* Begins to read `file`, which is borrowed: UTF-8 (or any one-byte encoding), or UTF-16 with a byte order mark. */
int obj_text_open(struct obj_text *text, const struct kiln_file *file, const char *scene, const char *name,
                  struct kiln_error *error);
void obj_text_close(struct obj_text *text);

/* Advances to the next line with a word and gives its first word; false at the end of the text. */
bool obj_next_line(struct obj_text *text, struct obj_word *keyword);
/* Gives the next word of the line; false at its end. */
bool obj_next_word(struct obj_text *text, struct obj_word *word);
/* The rest of the line, without surrounding blanks and without comment: a name that may contain blanks. */
struct obj_word obj_rest(struct obj_text *text);
/* Whether the line has another word. */
bool obj_more(struct obj_text *text);

bool obj_is(struct obj_word word, const char *text);
/* Parses the whole word as a finite number within +-3e38; false if it is anything else. */
bool obj_parse_number(struct obj_word word, double *value);
/* Parses all further words of the line as numbers; *count becomes their number. Fewer than `least` or more than `most`
 * are refused. */
int obj_numbers(struct obj_text *text, const char *keyword, double *values, size_t least, size_t most, size_t *count);

/* Fails with KILN_BAD_INPUT and "FILE: line N: WHAT 'WORD'..."; `word` may be NULL. */
int obj_fail(const struct obj_text *text, const char *what, const struct obj_word *word);

#endif
