/* Private parts of a job: shared by the sources that fill it in. */
#ifndef KILN_COORDINATOR_JOB_JOB_PRIVATE_H
#define KILN_COORDINATOR_JOB_JOB_PRIVATE_H

#include "coordinator/job/job.h"

/* Memory of a job: kiln_job.strings points to it. */
struct kiln_option;
struct kiln_job_owned {
    char **strings;
    size_t count, capacity;
    bool *given;   /* kiln_option_count flags: set by the job file or the command line, not by a default */
    bool *renamed; /* kiln_option_count flags: given by its former name, or by its own where it is a second value */
};

/* Stores a value that the user gave the option under `name`, and marks the option as given. FIRST:SECOND also sets the
 * option's second option, if it has one; FIRST alone resets a second value given so before. Otherwise as
 * kiln_option_set. */
int kiln_job_give(struct kiln_job *job, const struct kiln_option *option, const char *name, const char *text,
                  const char *where, int status, const char *folder, struct kiln_error *error);

/* Copies `length` bytes of `text` as a string that the job owns. */
int kiln_job_keep(struct kiln_job *job, const char *text, size_t length, char **copy, struct kiln_error *error);

/* Copies a path as a string that the job owns. A relative path gets `folder` in front unless `folder` is NULL. */
int kiln_job_keep_path(struct kiln_job *job, const char *path, const char *folder, char **copy,
                       struct kiln_error *error);

/* Sets job->output to its default in the current folder: the name of the scene (or job file) `path` without extension,
 * followed by `ending`. */
int kiln_job_default_output(struct kiln_job *job, const char *path, const char *ending, struct kiln_error *error);

/* Reads a YAML file of mappings, lists and values into JSON text that the job owns. KILN_BAD_INPUT, with file and line,
 * for any other content; KILN_NO_INPUT, KILN_PERMISSION or KILN_IO if it cannot be read. */
int kiln_job_yaml_read(struct kiln_job *job, const char *path, char **text, struct kiln_error *error);

enum { KILN_JOB_FILE_LIMIT = 1 << 20 }; /* bytes */

/* Reads the job file at `path` into the job. Its keys are the options and `scene`. KILN_BAD_INPUT, with file and line,
 * for wrong content; KILN_NO_INPUT, KILN_PERMISSION or KILN_IO if it cannot be read. */
int kiln_job_file_read(struct kiln_job *job, const char *path, struct kiln_error *error);

/* Reads settings of objects from one line of YAML, `{PATTERN: {KEY: VALUE, ...}, ...}`, and stores them in *kept as
 * JSON, which the job owns. `where` is the place for messages, `status` the code for refused text. */
int kiln_job_rules_parse(const char *text, const char *where, int status, struct kiln_job *job, char **kept,
                         struct kiln_error *error);

/* As kiln_job_file_read, but stores only the value of the key `quality`, if there is one. */
int kiln_job_file_read_quality(struct kiln_job *job, const char *path, struct kiln_error *error);

#endif
