/* Text of a page (or any other file of text) as it grows, and the plots on it. Errors stick: after one fails, the rest
 * do nothing, and page->status says what happened. Release with kiln_html_free. */
#ifndef KILN_COORDINATOR_FILES_HTML_H
#define KILN_COORDINATOR_FILES_HTML_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

struct kiln_html {
    char *text;
    size_t size, capacity;
    int status;
    struct kiln_error *error;
};

/* Adds text or markup as printf does. Text from outside goes through kiln_html_text. */
void kiln_html_add(struct kiln_html *page, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* Adds text, with what HTML would take for markup escaped. */
void kiln_html_text(struct kiln_html *page, const char *text);
/* Adds <img> with the bytes of a PNG file inside. */
void kiln_html_png(struct kiln_html *page, const char *png, size_t size, const char *alternative);

/* Publishes the text as the file `path` and releases it, or only releases it after an error. Returns the page's status,
 * or that of writing. */
int kiln_html_publish(struct kiln_html *page, const char *path);
void kiln_html_free(struct kiln_html *page);

/* An SVG of upright bars, one a value, from 0 to the largest; `names` has one a bar, or is NULL: then numbers from
 * `number_from` on. With `logarithmic` the height is by decades down to 1e-6 of the largest. */
void kiln_html_bars(struct kiln_html *page, const char *unit, const double *values, const char *const *names,
                    size_t count, int number_from, int logarithmic);
/* An SVG of lying bars with their names and values at the side. */
void kiln_html_rows(struct kiln_html *page, const char *unit, const double *values, const char *const *names,
                    size_t count);

#endif
