#include "worker/base/status.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

int kiln_fail(struct kiln_error *error, int status, const char *format, ...)
{
    if (error != NULL) {
        va_list arguments;
        va_start(arguments, format);
        (void)vsnprintf(error->message, sizeof error->message, format, arguments);
        va_end(arguments);
    }
    return status;
}

static int status_of_errno(int number)
{
    switch (number) {
    case EACCES:
    case EPERM:
        return KILN_PERMISSION;
    case ENOENT: /* there is no file of such a name, nor can there be */
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
        const int length = vsnprintf(error->message, sizeof error->message, format, arguments);
        va_end(arguments);
        if (length >= 0 && (size_t)length < sizeof error->message)
            (void)snprintf(error->message + length, sizeof error->message - (size_t)length, ": %s", strerror(number));
    }
    return status;
}
