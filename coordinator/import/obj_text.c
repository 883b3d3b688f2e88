#include "coordinator/import/obj_text.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "worker/base/memory.h"

/* ---- encodings ---- */

static size_t put_utf8(uint32_t code, unsigned char *out)
{
    if (code < 0x80) {
        out[0] = (unsigned char)code;
        return 1;
    }
    const size_t more = code < 0x800 ? 1 : code < 0x10000 ? 2 : 3;
    static const unsigned char lead[] = {0, 0xc0, 0xe0, 0xf0};
    out[0] = (unsigned char)(lead[more] | code >> (6 * more));
    for (size_t i = 1; i <= more; i++)
        out[i] = (unsigned char)(0x80 | (code >> (6 * (more - i)) & 0x3f));
    return more + 1;
}

/* Converts UTF-16 with a byte order mark to UTF-8: at most three bytes for two. */
static int convert_utf16(struct obj_text *text, const struct kiln_file *file, struct kiln_error *error)
{
    const size_t low = file->data[0] == 0xff ? 0 : 1, units = file->size / 2;
    const int status = kiln_allocate(&text->owned, 3 * units, 1, "the text of a file in UTF-16", error);
    if (status != KILN_OK)
        return status;
    size_t length = 0;
    for (size_t i = 1; i < units; i++) {
        uint32_t code = (uint32_t)file->data[2 * i + low] | (uint32_t)file->data[2 * i + 1 - low] << 8;
        const uint32_t next =
            i + 1 < units ? (uint32_t)file->data[2 * i + 2 + low] | (uint32_t)file->data[2 * i + 3 - low] << 8 : 0;
        if (code >= 0xd800 && code < 0xdc00 && next >= 0xdc00 && next < 0xe000) {
            code = 0x10000 + ((code - 0xd800) << 10) + (next - 0xdc00);
            i++;
        }
        length += put_utf8(code, text->owned + length);
    }
    text->at = text->owned;
    text->end = text->owned + length;
    return KILN_OK;
}

int obj_text_open(struct obj_text *text, const struct kiln_file *file, const char *scene, const char *name,
                  struct kiln_error *error)
{
    const bool wide = file->size >= 2 && ((file->data[0] == 0xff && file->data[1] == 0xfe) ||
                                          (file->data[0] == 0xfe && file->data[1] == 0xff));
    const size_t mark = file->size >= 3 && memcmp(file->data, "\xef\xbb\xbf", 3) == 0 ? 3 : 0;
    *text = (struct obj_text){
        .scene = scene, .name = name, .at = file->data + mark, .end = file->data + file->size, .error = error};
    return wide ? convert_utf16(text, file, error) : KILN_OK;
}

void obj_text_close(struct obj_text *text) { kiln_free(&text->owned); }

int obj_fail(const struct obj_text *text, const char *what, const struct obj_word *word)
{
    const int shown = word == NULL ? 0 : word->length < 40 ? (int)word->length : 40;
    return kiln_fail(text->error, KILN_BAD_INPUT,
                     "%.512s: %.120s%sline %llu: %s%s%.*s%s; repair the file or export it again", text->scene,
                     text->name, text->name[0] == '\0' ? "" : ", ", (unsigned long long)text->line, what,
                     word == NULL ? "" : " '", shown, word == NULL ? "" : word->text, word == NULL ? "" : "'");
}

/* ---- words ---- */

static bool blank(unsigned char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

/* Returns the length of a backslash and line end at this place, which continue the line; 0 if there are none. */
static size_t continuation(const struct obj_text *text)
{
    const unsigned char *at = text->at;
    if (text->end - at >= 2 && at[0] == '\\' && at[1] == '\n')
        return 2;
    return text->end - at >= 3 && at[0] == '\\' && at[1] == '\r' && at[2] == '\n' ? 3 : 0;
}

static void skip_blanks(struct obj_text *text)
{
    for (;;) {
        while (text->at < text->end && blank(*text->at))
            text->at++;
        const size_t skipped = continuation(text);
        if (skipped == 0)
            return;
        text->at += skipped;
        text->line++;
    }
}

bool obj_more(struct obj_text *text)
{
    skip_blanks(text);
    return text->at < text->end && *text->at != '\n' && *text->at != '#';
}

bool obj_next_word(struct obj_text *text, struct obj_word *word)
{
    if (!obj_more(text))
        return false;
    const unsigned char *first = text->at;
    while (text->at < text->end && !blank(*text->at) && *text->at != '\n' &&
           (*text->at != '\\' || continuation(text) == 0))
        text->at++;
    *word = (struct obj_word){(const char *)first, (size_t)(text->at - first)};
    return true;
}

struct obj_word obj_rest(struct obj_text *text)
{
    if (!obj_more(text))
        return (struct obj_word){"", 0};
    const unsigned char *first = text->at, *end = memchr(first, '\n', (size_t)(text->end - first));
    end = end == NULL ? text->end : end;
    text->at = end;
    while (end > first && blank(end[-1]))
        end--;
    return (struct obj_word){(const char *)first, (size_t)(end - first)};
}

bool obj_next_line(struct obj_text *text, struct obj_word *keyword)
{
    if (text->line > 0) { /* skips to the end of the current line */
        const unsigned char *end = text->at < text->end ? memchr(text->at, '\n', (size_t)(text->end - text->at)) : NULL;
        text->at = end == NULL ? text->end : end + 1;
    }
    for (text->line++; text->at < text->end; text->line++) {
        if (obj_next_word(text, keyword))
            return true;
        const unsigned char *end = text->at < text->end ? memchr(text->at, '\n', (size_t)(text->end - text->at)) : NULL;
        text->at = end == NULL ? text->end : end + 1;
    }
    return false;
}

bool obj_is(struct obj_word word, const char *text)
{
    return word.length == strlen(text) && memcmp(word.text, text, word.length) == 0;
}

/* ---- numbers ---- */

/* Exact powers of ten in double. */
static const double tens[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                              1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
enum { EXACT_DIGITS = 15, EXACT_TENS = 22, NUMBER_LENGTH = 400, EXPONENT_MAX = 100000 };

struct decimal {
    uint64_t digits; /* only the first EXACT_DIGITS digits */
    int digit_count, exponent;
    bool negative, seen;
};

static bool is_digit(char c) { return c >= '0' && c <= '9'; }

static const char *parse_digits(const char *at, const char *end, struct decimal *d, int point)
{
    for (; at < end && is_digit(*at); at++) {
        d->seen = true;
        if (d->digits > 0 || *at != '0')
            d->digit_count++;
        if (d->digit_count <= EXACT_DIGITS)
            d->digits = 10 * d->digits + (uint64_t)(*at - '0');
        d->exponent += d->digit_count <= EXACT_DIGITS ? -point : 1 - point;
    }
    return at;
}

static const char *parse_exponent(const char *at, const char *end, struct decimal *d)
{
    if (at == end || (*at != 'e' && *at != 'E'))
        return at;
    const bool negative = ++at < end && *at == '-';
    at += at < end && (*at == '-' || *at == '+');
    int value = 0;
    d->seen = at < end && is_digit(*at);
    for (; at < end && is_digit(*at); at++)
        value = value < EXPONENT_MAX ? 10 * value + (*at - '0') : value;
    d->exponent += negative ? -value : value;
    return at;
}

/* Parses a number that the fast way would round twice. The word is known to be a decimal number; the program's locale
 * is "C". */
static double slow_number(struct obj_word word)
{
    char copy[NUMBER_LENGTH + 1];
    memcpy(copy, word.text, word.length);
    copy[word.length] = '\0';
    return strtod(copy, NULL);
}

bool obj_parse_number(struct obj_word word, double *value)
{
    struct decimal d = {0};
    const char *at = word.text, *end = at + (word.length < NUMBER_LENGTH ? word.length : NUMBER_LENGTH);
    d.negative = at < end && *at == '-';
    at += at < end && (*at == '-' || *at == '+');
    at = parse_digits(at, end, &d, 0);
    if (at < end && *at == '.')
        at = parse_digits(at + 1, end, &d, 1);
    if (d.seen)
        at = parse_exponent(at, end, &d);
    if (!d.seen || at != end || word.length > NUMBER_LENGTH)
        return false;
    /* Both factors are exact, so the single operation rounds correctly. */
    const bool exact = d.digit_count <= EXACT_DIGITS && d.exponent >= -EXACT_TENS && d.exponent <= EXACT_TENS;
    if (exact || d.digits == 0) {
        const double size = d.digits == 0    ? 0.0
                            : d.exponent < 0 ? (double)d.digits / tens[-d.exponent]
                                             : (double)d.digits * tens[d.exponent];
        *value = d.negative ? -size : size;
    } else {
        *value = slow_number(word);
    }
    return fabs(*value) <= 3e38;
}

int obj_numbers(struct obj_text *text, const char *keyword, double *values, size_t least, size_t most, size_t *count)
{
    struct obj_word word;
    char what[80];
    for (*count = 0; obj_next_word(text, &word); ++*count) {
        if (*count == most) {
            (void)snprintf(what, sizeof what, "more than %zu numbers after %s:", most, keyword);
            return obj_fail(text, what, &word);
        }
        if (!obj_parse_number(word, &values[*count]))
            return obj_fail(text, "not a finite number:", &word);
    }
    if (*count >= least)
        return KILN_OK;
    (void)snprintf(what, sizeof what, "too few numbers after %s: %zu of %zu", keyword, *count, least);
    return obj_fail(text, what, NULL);
}
