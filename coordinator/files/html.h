/* HTML builder: a growing text buffer for a page, or any other text file, with simple plots. Errors are remembered:
 * after the first failure all functions do nothing, and page->status holds the status. Release with kiln_html_free. */
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

/* Adds text or markup, formatted as by printf. Text from outside must go through kiln_html_text. */
void kiln_html_add(struct kiln_html *page, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* Adds text, made safe for terminals (worker/base/text.h), and escapes the characters that are markup in HTML. */
void kiln_html_text(struct kiln_html *page, const char *text);
/* Adds an <img> element that contains the bytes of a PNG file. */
void kiln_html_png(struct kiln_html *page, const char *png, size_t size, const char *alternative);

/* Publishes the text as the file `path`, unless there was an error, and releases it. Returns the status of the page or
 * of writing. */
int kiln_html_publish(struct kiln_html *page, const char *path);
void kiln_html_free(struct kiln_html *page);

/* Adds an SVG bar chart with vertical bars from 0 to the largest value. `names` has a label for each bar; if it is
 * NULL, bars are numbered from `number_from`. With `logarithmic` heights are logarithmic, down to 1e-6 of the largest
 * value. */
void kiln_html_bars(struct kiln_html *page, const char *unit, const double *values, const char *const *names,
                    size_t count, int number_from, int logarithmic);
/* Adds an SVG bar chart with horizontal bars, with names and values beside them. */
void kiln_html_rows(struct kiln_html *page, const char *unit, const double *values, const char *const *names,
                    size_t count);

#endif
