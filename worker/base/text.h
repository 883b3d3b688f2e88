/* Text that others wrote, on its way to a terminal or a log: names in scenes, paths, lines of files.
 *
 * What a terminal would act on, or what could pass for a line of kiln's own, is written as \xNN, byte by byte: control
 * characters (C0, DEL, C1), line and paragraph separators, marks that turn the direction of writing, invisible tags,
 * and bytes that are no UTF-8. All else stays as it is, backslashes too, so that text that has been through here comes
 * out of it unchanged. */
#ifndef KILN_WORKER_BASE_TEXT_H
#define KILN_WORKER_BASE_TEXT_H

#include <stddef.h>
#include <stdio.h>

/* Writes `from` to `to` (size > 0 bytes, with the final 0) so; cut where it does not fit, never within a character or a
 * \xNN. Returns `to`. */
char *kiln_text_plain(char *to, size_t size, const char *from);

/* Copies `from`, cut where it does not fit, never within a character. */
void kiln_text_copy(char *to, size_t size, const char *from);

/* Takes the beginning of a character off the end of `text` whose rest was cut off. */
void kiln_text_trim(char *text);

/* As fprintf, through kiln_text_plain; at most 8,191 bytes. Of line feeds only the one that ends `format` is printed as
 * such. */
void kiln_print(FILE *stream, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
