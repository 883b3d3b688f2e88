/* What the files that fill a job share; for coordinator/cli only. */
#ifndef KILN_COORDINATOR_JOB_JOB_PRIVATE_H
#define KILN_COORDINATOR_JOB_JOB_PRIVATE_H

#include "coordinator/job/job.h"

/* Behind kiln_job.strings. */
struct kiln_job_owned {
    char **strings;
    size_t count, capacity;
    bool *given;   /* kiln_option_count flags: set by the job file or the command line, not by a default */
    bool *renamed; /* kiln_option_count flags: given by its former name */
};

/* Copies `length` bytes of `text` as a string that the job owns. */
int kiln_job_keep(struct kiln_job *job, const char *text, size_t length, char **copy, struct kiln_error *error);

/* `path` as the job owns it; a relative one gets `folder` in front when `folder` is not NULL. */
int kiln_job_keep_path(struct kiln_job *job, const char *path, const char *folder, char **copy,
                       struct kiln_error *error);

/* Where results go when that is not said: job->output becomes the name of the scene (or job file) `path` without its
 * extension, and `ending`; in the current folder. */
int kiln_job_default_output(struct kiln_job *job, const char *path, const char *ending, struct kiln_error *error);

enum { KILN_JOB_FILE_LIMIT = 1 << 20 }; /* bytes */

/* Reads the job file at `path` into the job: every key an option, and `scene`. KILN_BAD_INPUT names file and line;
 * KILN_NO_INPUT, KILN_PERMISSION, KILN_IO when it cannot be read. */
int kiln_job_file_read(struct kiln_job *job, const char *path, struct kiln_error *error);

/* Reads settings of objects from a line of YAML, `{PATTERN: {KEY: VALUE, ...}, ...}`, and keeps them as JSON. `where`
 * names the place in messages, `status` is the code of what is refused. */
int kiln_job_rules_parse(const char *text, const char *where, int status, struct kiln_job *job, char **kept,
                         struct kiln_error *error);

/* As kiln_job_file_read, but stores nothing except the value of the key `quality`, where that is given. */
int kiln_job_file_read_quality(struct kiln_job *job, const char *path, struct kiln_error *error);

#endif
