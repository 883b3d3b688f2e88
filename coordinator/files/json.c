#include "coordinator/files/json.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/files/standard_output.h"

json_t *kiln_json_string(const char *text)
{
    json_t *string = json_string(text);
    if (string != NULL)
        return string;
    char *plain = strdup(text);
    for (char *at = plain; at != NULL && *at != '\0'; at++)
        *at = (*at & 0x80) != 0 ? '?' : *at;
    string = plain != NULL ? json_string(plain) : NULL;
    free(plain);
    return string;
}

/* json_dump_callback: writes ASCII text, and escapes DEL, the one control character that JSON allows unescaped. */
static int write_plain(const char *bytes, size_t size, void *stream)
{
    for (size_t i = 0; i < size; i++)
        if ((bytes[i] == 0x7f ? fputs("\\u007f", stream) : fputc(bytes[i], stream)) == EOF)
            return -1;
    return 0;
}

int kiln_json_print(json_t *object, struct kiln_error *error)
{
    if (object == NULL)
        return kiln_fail(error, KILN_SYSTEM, "out of memory for the JSON object");
    const int failed = json_dump_callback(object, write_plain, stdout, JSON_COMPACT | JSON_ENSURE_ASCII);
    json_decref(object);
    (void)fputc('\n', stdout);
    return failed != 0 ? kiln_stdout_flush(error) : KILN_OK;
}
