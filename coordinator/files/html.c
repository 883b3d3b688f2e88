#include "coordinator/files/html.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/files/publish.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

static char *room(struct kiln_html *page, size_t more)
{
    if (page->status == KILN_OK)
        page->status = kiln_grow(&page->text, &page->capacity, page->size + more + 1, 1, "a page", page->error);
    return page->status == KILN_OK ? page->text + page->size : NULL;
}

void kiln_html_add(struct kiln_html *page, const char *format, ...)
{
    va_list arguments, again;
    va_start(arguments, format);
    va_copy(again, arguments);
    const int length = vsnprintf(NULL, 0, format, arguments);
    char *at = length < 0 ? NULL : room(page, (size_t)length);
    if (at != NULL) {
        (void)vsnprintf(at, (size_t)length + 1, format, again);
        page->size += (size_t)length;
    }
    va_end(again);
    va_end(arguments);
}

int kiln_html_publish(struct kiln_html *page, const char *path)
{
    const int status =
        page->status == KILN_OK ? kiln_publish_bytes(path, page->text, page->size, page->error) : page->status;
    kiln_html_free(page);
    return status;
}

void kiln_html_free(struct kiln_html *page) { kiln_free(&page->text); }

static void add_bytes(struct kiln_html *page, const char *bytes, size_t size)
{
    char *at = room(page, size);
    if (at == NULL)
        return;
    memcpy(at, bytes, size);
    at[size] = '\0';
    page->size += size;
}

/* Adds plain text, whose markup it escapes. Without a format for each piece: a text may be nothing but markup. */
static void escape(struct kiln_html *page, const char *text)
{
    while (*text != '\0') {
        const size_t plain = strcspn(text, "<>&\"");
        add_bytes(page, text, plain);
        text += plain;
        const char *escaped = *text == '<' ? "&lt;" : *text == '>' ? "&gt;" : *text == '&' ? "&amp;" : "&quot;";
        if (*text != '\0')
            add_bytes(page, escaped, strlen(escaped));
        text += *text != '\0';
    }
}

void kiln_html_text(struct kiln_html *page, const char *text)
{
    char *plain = NULL;
    const size_t size = 4 * strlen(text) + 1; /* each byte may become \xNN */
    if (page->status == KILN_OK)
        page->status = kiln_allocate(&plain, size, 1, "a page", page->error);
    if (plain != NULL)
        escape(page, kiln_text_plain(plain, size, text));
    kiln_free(&plain);
}

static void add_base64(struct kiln_html *page, const unsigned char *bytes, size_t size)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    char *at = room(page, (size + 2) / 3 * 4);
    if (at == NULL)
        return;
    for (size_t i = 0; i < size; i += 3) {
        const uint32_t group = (uint32_t)bytes[i] << 16 | (uint32_t)(i + 1 < size ? bytes[i + 1] : 0) << 8 |
                               (i + 2 < size ? bytes[i + 2] : 0);
        *at++ = digits[group >> 18];
        *at++ = digits[group >> 12 & 63];
        *at++ = i + 1 < size ? digits[group >> 6 & 63] : '=';
        *at++ = i + 2 < size ? digits[group & 63] : '=';
    }
    *at = '\0';
    page->size = (size_t)(at - page->text);
}

void kiln_html_png(struct kiln_html *page, const char *png, size_t size, const char *alternative)
{
    kiln_html_add(page, "<img alt=\"");
    kiln_html_text(page, alternative);
    kiln_html_add(page, "\" src=\"data:image/png;base64,");
    add_base64(page, (const unsigned char *)png, size);
    kiln_html_add(page, "\">");
}

static double largest_of(const double *values, size_t count)
{
    double largest = 0.0;
    for (size_t i = 0; i < count; i++)
        largest = isfinite(values[i]) && values[i] > largest ? values[i] : largest;
    return largest;
}

static double share(double value, double largest, int logarithmic)
{
    const double part = largest > 0.0 && isfinite(value) && value > 0.0 ? value / largest : 0.0;
    if (!logarithmic || part == 0.0)
        return part;
    return fmax(0.0, 1.0 + log10(part) / 6.0);
}

void kiln_html_bars(struct kiln_html *page, const char *unit, const double *values, const char *const *names,
                    size_t count, int number_from, int logarithmic)
{
    const double width = 640.0, height = 160.0, left = 70.0, largest = largest_of(values, count);
    const double step = count > 0 ? (width - left) / (double)count : width;
    const size_t every = count > 32 ? count / 16 : 1; /* some names are skipped so that they do not overlap */
    kiln_html_add(page, "<svg viewBox=\"0 0 %.0f %.0f\" width=\"%.0f\" role=\"img\">", width, height + 30.0, width);
    kiln_html_add(
        page, "<text x=\"%.0f\" y=\"12\" text-anchor=\"end\">%.4g</text><text x=\"%.0f\" y=\"26\" text-anchor=\"end\">",
        left - 6.0, largest, left - 6.0);
    kiln_html_text(page, unit);
    kiln_html_add(page, "</text>");
    kiln_html_add(page, "<text x=\"%.0f\" y=\"%.0f\" text-anchor=\"end\">%.3g</text>", left - 6.0, height,
                  logarithmic ? largest * 1e-6 : 0.0);
    kiln_html_add(page, "<line x1=\"%.0f\" y1=\"%.0f\" x2=\"%.0f\" y2=\"%.0f\"/>", left, height, width, height);
    for (size_t i = 0; i < count; i++) {
        const double tall = (height - 4.0) * share(values[i], largest, logarithmic), x = left + step * (double)i;
        kiln_html_add(page, "<rect x=\"%.2f\" y=\"%.2f\" width=\"%.2f\" height=\"%.2f\"><title>", x + 0.1 * step,
                      height - tall, 0.8 * step, tall);
        if (names != NULL)
            kiln_html_text(page, names[i]);
        else
            kiln_html_add(page, "%d", number_from + (int)i);
        kiln_html_add(page, ": %.6g ", values[i]);
        kiln_html_text(page, unit);
        kiln_html_add(page, "</title></rect>");
        if (i % every != 0)
            continue;
        kiln_html_add(page, "<text x=\"%.2f\" y=\"%.0f\" text-anchor=\"middle\">", x + 0.5 * step, height + 16.0);
        if (names != NULL)
            kiln_html_text(page, names[i]);
        else
            kiln_html_add(page, "%d", number_from + (int)i);
        kiln_html_add(page, "</text>");
    }
    kiln_html_add(page, "</svg>\n");
}

void kiln_html_rows(struct kiln_html *page, const char *unit, const double *values, const char *const *names,
                    size_t count)
{
    const double width = 640.0, left = 150.0, right = 110.0, row = 20.0, largest = largest_of(values, count);
    kiln_html_add(page, "<svg viewBox=\"0 0 %.0f %.0f\" width=\"%.0f\" role=\"img\">", width, row * (double)count + 4.0,
                  width);
    for (size_t i = 0; i < count; i++) {
        const double y = row * (double)i, length = (width - left - right) * share(values[i], largest, 0);
        kiln_html_add(page, "<text x=\"%.0f\" y=\"%.0f\" text-anchor=\"end\">", left - 6.0, y + 15.0);
        kiln_html_text(page, names[i]);
        kiln_html_add(page, "</text><rect x=\"%.0f\" y=\"%.0f\" width=\"%.2f\" height=\"%.0f\"/>", left, y + 3.0,
                      length, row - 6.0);
        kiln_html_add(page, "<text x=\"%.2f\" y=\"%.0f\">%.4g %s</text>", left + length + 6.0, y + 15.0, values[i],
                      unit);
    }
    kiln_html_add(page, "</svg>\n");
}
