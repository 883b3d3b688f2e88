#include "worker/base/text.h"

#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

/* Returns the number of bytes of the UTF-8 character at `at` (RFC 3629) and its code point; 0 if it is invalid or
 * incomplete. */
static size_t decode(const unsigned char *at, uint32_t *character)
{
    static const uint32_t least[5] = {0, 0, 0x80, 0x800, 0x10000};
    const size_t length = at[0] < 0x80                    ? 1
                          : at[0] >= 0xc2 && at[0] < 0xe0 ? 2
                          : at[0] >= 0xe0 && at[0] < 0xf0 ? 3
                          : at[0] >= 0xf0 && at[0] < 0xf5 ? 4
                                                          : 0;
    if (length == 0)
        return 0;
    *character = length == 1 ? at[0] : at[0] & (0xffu >> (length + 1));
    for (size_t i = 1; i < length; i++) {
        if ((at[i] & 0xc0) != 0x80) /* also catches the final 0 */
            return 0;
        *character = *character << 6 | (at[i] & 0x3fu);
    }
    const bool surrogate = *character >= 0xd800 && *character < 0xe000;
    return *character < least[length] || *character > 0x10ffff || surrogate ? 0 : length;
}

static bool acts(uint32_t c)
{
    return c < 0x20 || (c >= 0x7f && c < 0xa0) || c == 0x61c || c == 0x200e || c == 0x200f ||
           (c >= 0x2028 && c <= 0x202e) || (c >= 0x2066 && c <= 0x2069) || (c >= 0xe0000 && c < 0xe0080);
}

char *kiln_text_plain(char *to, size_t size, const char *from)
{
    size_t used = 0;
    for (const unsigned char *at = (const unsigned char *)from; *at != '\0';) {
        uint32_t character = 0;
        const size_t length = decode(at, &character), bytes = length > 0 ? length : 1;
        const bool plain = length > 0 && !acts(character);
        const size_t room = plain ? bytes : 4 * bytes;
        if (used + room >= size)
            break;
        for (size_t i = 0; plain && i < bytes; i++)
            to[used + i] = (char)at[i];
        for (size_t i = 0; !plain && i < bytes; i++) {
            static const char digits[] = "0123456789abcdef";
            const char code[4] = {'\\', 'x', digits[at[i] >> 4], digits[at[i] & 15]};
            memcpy(to + used + 4 * i, code, sizeof code);
        }
        used += room;
        at += bytes;
    }
    to[used] = '\0';
    return to;
}

void kiln_text_trim(char *text)
{
    size_t length = strlen(text), begin = length;
    while (begin > 0 && length - begin < 3 && ((unsigned char)text[begin - 1] & 0xc0) == 0x80)
        begin--;
    if (begin == 0 || (unsigned char)text[begin - 1] < 0xc0)
        return;
    uint32_t character;
    if (decode((const unsigned char *)text + begin - 1, &character) == 0)
        text[begin - 1] = '\0';
}

void kiln_text_copy(char *to, size_t size, const char *from)
{
    const size_t length = strlen(from), kept = length < size ? length : size - 1;
    memcpy(to, from, kept);
    to[kept] = '\0';
    if (kept < length)
        kiln_text_trim(to);
}

void kiln_print(FILE *stream, const char *format, ...)
{
    enum { SIZE = 8192 };
    char text[SIZE], plain[SIZE];
    const size_t length = strlen(format);
    const bool line = length > 0 && format[length - 1] == '\n';
    va_list arguments;
    va_start(arguments, format);
    const int wanted = vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    const size_t got = strlen(text);
    if (wanted >= SIZE)
        kiln_text_trim(text);
    else if (line && got > 0)
        text[got - 1] = '\0';
    (void)fputs(kiln_text_plain(plain, sizeof plain, text), stream);
    if (line)
        (void)fputc('\n', stream);
}
