/* Text from outside (names in scenes, paths, lines of files) made safe for a terminal or a log.
 *
 * Characters that a terminal would act on, or that could imitate a line of kiln's own, are written as \xNN, byte by
 * byte: control characters (C0, DEL, C1), line and paragraph separators, marks of writing direction, invisible tags,
 * and bytes that are not UTF-8. All else stays as it is, backslashes too, so that a second pass changes nothing. */
#ifndef KILN_WORKER_BASE_TEXT_H
#define KILN_WORKER_BASE_TEXT_H

#include <stddef.h>
#include <stdio.h>

/* Writes `from`, made safe, to `to` (size > 0 bytes, with the final 0). Text that does not fit is cut off, never within
 * a character or a \xNN. Returns `to`. */
char *kiln_text_plain(char *to, size_t size, const char *from);

/* Copies `from`. Text that does not fit is cut off, never within a character. */
void kiln_text_copy(char *to, size_t size, const char *from);

/* Removes an incomplete character from the end of `text`, where the rest of the character was cut off. */
void kiln_text_trim(char *text);

/* As fprintf, with the result made safe; at most 8,191 bytes. Only a line feed that ends `format` is printed as a line
 * feed. */
void kiln_print(FILE *stream, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
