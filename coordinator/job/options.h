/* The tables of options, quality presets and commands. The command line, the job file reader and `--help` read these
 * and nothing else: an option that is not here does not exist, and a choice that is not listed here is refused. */
#ifndef KILN_COORDINATOR_JOB_OPTIONS_H
#define KILN_COORDINATOR_JOB_OPTIONS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "coordinator/job/job.h"

/* m: no place that an option names may be farther off; more than any scene's size (kiln_scene_open's bound), and small
 * enough that the squares that tracers take fit a float. */
#define KILN_PLACE_MOST 1e15

enum kiln_option_kind {
    KILN_OPTION_FLAG,        /* bool; --name, --no-name; true or false in a job file */
    KILN_OPTION_UINT32,      /* whole number */
    KILN_OPTION_UINT64,      /* whole number */
    KILN_OPTION_INT64,       /* whole number */
    KILN_OPTION_DOUBLE,      /* finite number */
    KILN_OPTION_STRING,      /* any text */
    KILN_OPTION_PATH,        /* a file or folder; in a job file relative to the job file's folder */
    KILN_OPTION_ENVIRONMENT, /* none | R,G,B | a path ending in .hdr or .exr */
    KILN_OPTION_POINT,       /* text "x,y,z" of three numbers within KILN_PLACE_MOST, metres */
    /* settings by pattern of objects' names: a mapping of mappings in a job file, {PATTERN: {KEY: VALUE}} in one line
       elsewhere; kept as JSON, see coordinator/job/object_settings.h */
    KILN_OPTION_RULES,
    KILN_OPTION_CHOICE,      /* one of `choices`, kept as text */
    KILN_OPTION_CHOICE_ENUM, /* one of `choices`, kept as its index in an enum (int) */
    KILN_OPTION_CHOICE_FLAG  /* one of two `choices`, kept as bool: false for the first */
};

enum kiln_command_bit {
    KILN_FOR_BAKE = 1,
    KILN_FOR_PLAN = 2,
    KILN_FOR_INFO = 4,
    KILN_FOR_CHECK = 8,
    KILN_FOR_VIEW = 16,
    KILN_FOR_COMPARE = 32,
    KILN_FOR_PROBE = 64,
    KILN_FOR_GENERATE = 128,
    KILN_FOR_REPORT = 256,
    KILN_FOR_BENCH = 512,
    KILN_FOR_SUBMIT = 1024,
    KILN_FOR_STATUS = 2048,
    KILN_FOR_STOP = 4096,
    KILN_FOR_VERIFY = 8192,
    KILN_FOR_EXPORT = 16384,
    KILN_FOR_ALL = 32767
};

struct kiln_option {
    const char *name;   /* "samples-direct": the key of a job file; with "--" before it, the option */
    const char *former; /* the name it had in the version before, which is still accepted; NULL: none */
    const char *group;  /* heading in --help */
    enum kiln_option_kind kind;
    const char *value;          /* placeholder that carries the unit: "METRES"; NULL for flags and choices */
    const char *fallback;       /* the default, as text that is parsed like a value given; NULL: zero */
    const char *shown;          /* the default as --help shows it; NULL: `fallback` */
    double minimum, maximum;    /* numbers: both inclusive */
    const char *word;           /* a word accepted in place of a number, NULL: none */
    double word_value;          /* what that word stands for */
    const char *const *choices; /* ends with NULL */
    int refusal;       /* status for a choice that is not listed; 0: KILN_USAGE, or KILN_BAD_INPUT in a job file */
    const char *help;  /* one line */
    uint32_t commands; /* enum kiln_command_bit, or-ed */
    size_t offset;     /* in struct kiln_job */
};

extern const struct kiln_option kiln_options[];
extern const size_t kiln_option_count;

/* What each --quality sets. */
struct kiln_quality {
    const char *name;
    uint32_t samples_direct, samples_bounce, samples_indirect, samples_probe;
};
extern const struct kiln_quality kiln_qualities[];
extern const size_t kiln_quality_count;

struct kiln_command {
    const char *name;
    uint32_t bit;
    const char *arguments;   /* as shown in usage lines: "SCENE|JOB.yaml" */
    size_t minimum, maximum; /* how many arguments */
    bool scene;              /* the first argument is a scene or a job file */
    bool folder;             /* the first argument is the folder of a bake */
    bool mpi;                /* runs between MPI_Init and MPI_Finalize */
    const char *summary;     /* one line */
    const char *examples[5]; /* command lines, ends with NULL */
};
extern const struct kiln_command kiln_commands[];
extern const size_t kiln_command_count;

/* The option with that name, present or former. NULL when there is none. */
const struct kiln_option *kiln_option_find(const char *name);
/* The same; where several options have that name, the one that belongs to one of `commands`. --partition is the unit of
 * work of bake and the Slurm partition of submit; --ranks is a number for plan and a list for bench. */
const struct kiln_option *kiln_option_find_for(const char *name, uint32_t commands);
const struct kiln_command *kiln_command_find(const char *name);

/* Optimal string alignment distance: how many insertions, deletions, substitutions and swaps of neighbours lie between.
 */
size_t kiln_edit_distance(const char *a, const char *b);

/* Whether `known` may have been meant by `name`: less than a third of the longer one's letters differ, or `name` is how
 * it begins (three letters at least). */
bool kiln_is_near(const char *name, const char *known);

/* The near name with the least edit distance from `name`; the first in the table when several are as near; NULL when
 * none is near. For options only those with a bit of `commands` count. */
const char *kiln_option_nearest(const char *name, uint32_t commands);
const char *kiln_command_nearest(const char *name);

/* KILN_USAGE with the sentence for a command that does not exist. */
int kiln_command_unknown(const char *name, struct kiln_error *error);

/* How messages and --help call the default of an option; "" where there is none worth naming. */
const char *kiln_option_default(const struct kiln_option *option);

/* Parses `text` strictly (no trailing characters, no NaN, range checked) and stores it in the job. `where` names the
 * place in messages ("--threads", "job.yaml:3: threads"); `status` is the code for a value that is refused. Strings are
 * copied and owned by the job. `folder` (or NULL) is put before relative paths. */
int kiln_option_set(struct kiln_job *job, const struct kiln_option *option, const char *text, const char *where,
                    int status, const char *folder, struct kiln_error *error);

/* An option's value in the job as text, as it could be given: the job's own string, a static one, or written to `room`.
 */
enum { KILN_OPTION_TEXT = 64 };
const char *kiln_option_text(const struct kiln_job *job, const struct kiln_option *option, char room[KILN_OPTION_TEXT]);

/* The screens of `kiln help` (command NULL) and `kiln COMMAND --help`. */
void kiln_help(FILE *stream, const struct kiln_command *command);

#endif
