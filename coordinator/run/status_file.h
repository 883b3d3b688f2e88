/* DIR/checkpoint/status.json: where a running bake is, for anybody who can read the folder; and DIR/checkpoint/stop, by
 * which it is asked to end.
 *
 * Rank 0 of a bake writes the first once a second, aside and then over the old one, so that a reader sees a whole file.
 * It goes with the checkpoint when the bake ends well (run.json says that then), and when a bake fails before there is
 * one. */
#ifndef KILN_COORDINATOR_RUN_STATUS_FILE_H
#define KILN_COORDINATOR_RUN_STATUS_FILE_H

#include <stdbool.h>
#include <stdint.h>

#include "worker/base/status.h"

struct kiln_bake_status {
    char state[16]; /* "running", "stopped", "failed" */
    char phase[64];
    double share;   /* of the phase, 0..1; -1: not known */
    double left;    /* s, of the phase; -1: not known */
    double seconds; /* since the bake (this run of it) began */
    int32_t ranks;
    char host[64];       /* of rank 0 */
    int64_t process;     /* its process there */
    uint64_t started;    /* when that started, in the kernel's ticks: tells it from a later one of the same number */
    double updated;      /* s since 1970 */
    uint64_t beat;       /* counts the writings */
    uint64_t generation; /* of the last checkpoint; 0: none */
    double saved;        /* when, s since 1970 */
    int32_t code;        /* exit status, when not running */
    char message[512];   /* the sentence, when not running */
};

/* None of these is collective. */

/* Fills host, process, started, updated of this process. */
void kiln_bake_status_sign(struct kiln_bake_status *status);
/* Writes the file; the folder DIR/checkpoint is there. Failures are of no consequence. */
void kiln_bake_status_write(const char *directory, const struct kiln_bake_status *status);
/* KILN_NO_INPUT when there is no such file; KILN_BAD_INPUT when it is not one of ours. */
int kiln_bake_status_read(const char *directory, struct kiln_bake_status *status, struct kiln_error *error);
void kiln_bake_status_remove(const char *directory);

/* Whether the process that wrote it is alive: on this host by its number; from another by whether the file changes,
 * which is watched for up to three seconds unless it is old. */
bool kiln_bake_status_alive(const char *directory, const struct kiln_bake_status *status);

/* When a process of this host started, in the kernel's ticks; 0: there is none, or it is dead. */
uint64_t kiln_process_started(int64_t process);

/* The request to stop. */
int kiln_stop_request(const char *directory, struct kiln_error *error);
bool kiln_stop_requested(const char *directory);
void kiln_stop_forget(const char *directory);

#endif
