/* Reader of YAML events, shared by the readers of job files and of rules of objects. Private to coordinator/job. */
#ifndef KILN_COORDINATOR_JOB_JOB_READER_H
#define KILN_COORDINATOR_JOB_JOB_READER_H

#include <jansson.h>
#include <yaml.h>

#include "coordinator/job/job_private.h"

struct kiln_job_reader {
    struct kiln_job *job;
    const char *path;
    int refusal;  /* status of errors in the text; 0: KILN_BAD_INPUT */
    char *folder; /* folder of the job file; "." for the current one */
    char *text;   /* the whole file */
    size_t length;
    bool only_quality;
    bool *seen; /* kiln_option_count + 2 flags, the last for `scene` and `parts` */
    yaml_parser_t parser;
    bool parser_made;
};

static inline size_t kiln_job_line(const yaml_mark_t *mark) { return mark->line + 1; }

/* Reads the next event, which the caller deletes. */
int kiln_job_next(struct kiln_job_reader *reader, yaml_event_t *event, struct kiln_error *error);

/* Checks that the event is a scalar without a NUL character. */
int kiln_job_expect_scalar(const struct kiln_job_reader *reader, const yaml_event_t *event, const char *what,
                           struct kiln_error *error);

/* Takes the next event, which must be of the type given; `complaint` says what is wrong otherwise. */
int kiln_job_expect(struct kiln_job_reader *reader, yaml_event_type_t type, const char *complaint,
                    struct kiln_error *error);

/* A scalar as JSON: true, false and numbers keep their type unless they are quoted; everything else is a string. */
json_t *kiln_job_scalar_json(const yaml_event_t *event);

/* Reads the list of `parts:`, after its start in `line`, and gives it to the job (parts.h). */
int kiln_job_parts_list(struct kiln_job_reader *reader, size_t line, struct kiln_error *error);

/* Reads the rules of `objects:`, after the start of their mapping, and stores them in *kept as JSON. */
int kiln_job_rules_read(struct kiln_job_reader *reader, char **kept, struct kiln_error *error);

#endif
