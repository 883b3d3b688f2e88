/* Private to coordinator/import/obj*.c: the text of OBJ and MTL files, line by line and word by word, as it lies in the
 * mapped file.
 *
 * A line ends with LF or CR LF; a backslash before its end continues it; '#' begins a comment. Words are separated by
 * blanks and tabs. Numbers have a point whatever the locale. */
#ifndef KILN_COORDINATOR_IMPORT_OBJ_TEXT_H
#define KILN_COORDINATOR_IMPORT_OBJ_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/import/confine.h"

struct obj_text {
    const char *scene, *name; /* begin sentences; name is empty in the scene's own file; borrowed */
    const unsigned char *at, *end;
    uint64_t line;
    struct kiln_error *error;
    unsigned char *owned; /* what was UTF-16 */
};

/* Bytes of the text, not terminated. */
struct obj_word {
    const char *text;
    size_t length;
};

/* Begins to read `file`, which is borrowed: UTF-8 (or any one-byte encoding), or UTF-16 with its mark. */
int obj_text_open(struct obj_text *text, const struct kiln_file *file, const char *scene, const char *name,
                  struct kiln_error *error);
void obj_text_close(struct obj_text *text);

/* The first word of the next line that has one; false at the end of the text. */
bool obj_next_line(struct obj_text *text, struct obj_word *keyword);
/* The next word of this line; false at its end. */
bool obj_next_word(struct obj_text *text, struct obj_word *word);
/* What is left of this line, without blanks around it and without comment: a name with blanks in it. */
struct obj_word obj_rest(struct obj_text *text);
/* Whether the line has another word. */
bool obj_more(struct obj_text *text);

bool obj_is(struct obj_word word, const char *text);
/* The whole word as a finite number within +-3e38; false when it is something else. */
bool obj_parse_number(struct obj_word word, double *value);
/* All further words of the line as numbers; their number goes to *count, and those beyond `most` are refused. */
int obj_numbers(struct obj_text *text, const char *keyword, double *values, size_t least, size_t most, size_t *count);

/* KILN_BAD_INPUT with "FILE: line N: ..."; a word may be NULL. */
int obj_fail(const struct obj_text *text, const char *what, const struct obj_word *word);

#endif
