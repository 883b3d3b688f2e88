#include "worker/base/status.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>

#include "worker/base/text.h"

/* Formats the message as plain text: one line without control characters, whatever names and files it contains. */
static void take(struct kiln_error *error, const char *format, va_list arguments) __attribute__((format(printf, 2, 0)));
static void take(struct kiln_error *error, const char *format, va_list arguments)
{
    char text[sizeof error->message];
    const int length = vsnprintf(text, sizeof text, format, arguments);
    if (length >= (int)sizeof text)
        kiln_text_trim(text);
    (void)kiln_text_plain(error->message, sizeof error->message, text);
}

int kiln_fail(struct kiln_error *error, int status, const char *format, ...)
{
    if (error != NULL) {
        va_list arguments;
        va_start(arguments, format);
        take(error, format, arguments);
        va_end(arguments);
    }
    return status;
}

int kiln_fail_table(struct kiln_error *error, int status, const char *table, const char *format, ...)
{
    if (error != NULL) {
        va_list arguments;
        va_start(arguments, format);
        take(error, format, arguments);
        va_end(arguments);
        const size_t used = strlen(error->message);
        kiln_text_copy(error->message + used, sizeof error->message - used, table);
    }
    return status;
}

static int status_of_errno(int number)
{
    switch (number) {
    case EACCES:
    case EPERM:
        return KILN_PERMISSION;
    case ENOENT: /* such a name exists on no file system */
    case ENAMETOOLONG:
    case ENOTDIR:
    case ELOOP:
        return KILN_NO_INPUT;
    case ENOMEM:
        return KILN_SYSTEM;
    default:
        return KILN_IO;
    }
}

int kiln_fail_errno(struct kiln_error *error, int status, const char *format, ...)
{
    const int number = errno;
    if (status == 0)
        status = status_of_errno(number);
    if (error != NULL) {
        va_list arguments;
        va_start(arguments, format);
        take(error, format, arguments);
        va_end(arguments);
        const size_t used = strlen(error->message);
        struct rlimit most;
        if (number == EFBIG && getrlimit(RLIMIT_FSIZE, &most) == 0 && most.rlim_cur != RLIM_INFINITY)
            (void)snprintf(error->message + used, sizeof error->message - used,
                           ": this process may write files of at most %llu bytes (ulimit -f)",
                           (unsigned long long)most.rlim_cur);
        else
            (void)snprintf(error->message + used, sizeof error->message - used, ": %s", strerror(number));
    }
    return status;
}
