/* Status codes and the error sentence that goes with them.
 *
 * A function that can fail returns int: 0 (KILN_OK) or one of the codes below, which are also the program's exit codes
 * (sysexits.h, extended). Its last argument is a struct kiln_error that receives one sentence: which file, which place
 * in it, which value is wrong, and what to do. On success the struct is left alone. Violated invariants of the program
 * itself are assertions instead. */
#ifndef KILN_WORKER_BASE_STATUS_H
#define KILN_WORKER_BASE_STATUS_H

enum kiln_status {
    KILN_OK = 0,
    KILN_USAGE = 64,         /* wrong command line */
    KILN_BAD_INPUT = 65,     /* scene or job is broken */
    KILN_NO_INPUT = 66,      /* input missing */
    KILN_NO_DEVICE = 69,     /* no such device, or it was lost */
    KILN_BUG = 70,           /* a bug in kiln */
    KILN_SYSTEM = 71,        /* operating system or memory */
    KILN_CANNOT_CREATE = 73, /* output cannot be created */
    KILN_IO = 74,            /* input/output error */
    KILN_STOPPED = 75,       /* stopped on purpose with a checkpoint; run again */
    KILN_RANK_LOST = 76,     /* a rank or node was lost; run again */
    KILN_PERMISSION = 77,    /* permission denied */
    KILN_SITE = 78           /* the site's set-up is wrong */
};

struct kiln_error {
    /* UTF-8 without control characters (text.h); one line, unless a table follows; empty when nothing failed */
    char message[2048];
};

/* Checks a call that returns a status. KILN_OK: goes on. Any other code: stores it in the function's variable `status`
 * and goes to its label `end`, where resources are released. */
#define KILN_TRY(call)                                                                                                 \
    do {                                                                                                               \
        status = (call);                                                                                               \
        if (status != KILN_OK)                                                                                         \
            goto end;                                                                                                  \
    } while (0)

/* Writes the sentence and returns `status`, so that a failing function can say `return kiln_fail(error, KILN_IO, ...)`.
 * `error` may be NULL: the sentence is dropped. Text from outside must be an argument, never the format. Control
 * characters in it, line feeds too, are written as \xNN. */
int kiln_fail(struct kiln_error *error, int status, const char *format, ...) __attribute__((format(printf, 3, 4)));

/* As kiln_fail, with `table` after the sentence. Each row of the table begins with a line feed. Cells from outside must
 * have gone through kiln_text_plain. */
int kiln_fail_table(struct kiln_error *error, int status, const char *table, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* As kiln_fail, with ": " and the text of errno at the end (for EFBIG: the process's file size limit). If `status` is
 * 0, chooses KILN_PERMISSION for EACCES and EPERM, KILN_NO_INPUT for ENOENT, KILN_SYSTEM for ENOMEM. */
int kiln_fail_errno(struct kiln_error *error, int status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

#endif
