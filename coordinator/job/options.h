/* The tables of options, quality presets and commands. The command line, the job file reader and --help work from these
 * tables alone: an option that is not listed here does not exist, and a choice that is not listed here is refused. */
#ifndef KILN_COORDINATOR_JOB_OPTIONS_H
#define KILN_COORDINATOR_JOB_OPTIONS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "coordinator/job/job.h"

struct kiln_condition;

/* Largest coordinate of a point that an option names, m. It exceeds the size of any scene that kiln_scene_open accepts,
 * and its square still fits a float. */
#define KILN_PLACE_MOST 1e15

/* Largest radiance, intensity or irradiance that an option or a file may name, in its unit. It is 10^8 times the
 * radiance of the sun, and a lamp of 1 W/sr that lights a scene of a thousand kilometres has 10^12. Squares of it, over
 * small densities, still fit a float. */
#define KILN_LIGHT_MOST 1e15

enum kiln_option_kind {
    KILN_OPTION_FLAG,        /* bool: --name or --no-name; true or false in a job file */
    KILN_OPTION_UINT32,      /* whole number */
    KILN_OPTION_UINT64,      /* whole number */
    KILN_OPTION_INT64,       /* whole number */
    KILN_OPTION_DOUBLE,      /* finite number */
    KILN_OPTION_STRING,      /* any text */
    KILN_OPTION_LINES,       /* any text, more than once: a line each */
    KILN_OPTION_PATH,        /* a file or folder; in a job file relative to the job file's folder */
    KILN_OPTION_ENVIRONMENT, /* none | R,G,B | a path ending in .hdr or .exr */
    KILN_OPTION_POINT,       /* text "x,y,z", metres, each within KILN_PLACE_MOST */
    KILN_OPTION_BOX,         /* text "x,y,z,x,y,z", metres: the least corner and the greatest */
    /* settings of objects by patterns of their names: a mapping of mappings in a job file, {PATTERN: {KEY: VALUE}} on
       the command line; stored as JSON, see coordinator/job/object_settings.h */
    KILN_OPTION_RULES,
    KILN_OPTION_CHOICE,      /* one of `choices`, stored as text */
    KILN_OPTION_CHOICE_ENUM, /* one of `choices`, stored as its index (int), the value of an enum */
    KILN_OPTION_CHOICE_FLAG  /* one of two `choices`, stored as bool: false for the first */
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
    KILN_FOR_RELIGHT = 32768,
    KILN_FOR_MIX = 65536,
    KILN_FOR_IMPORT = 131072,
    KILN_FOR_ALL = 262143
};

/* A word that stands for a number. */
struct kiln_option_word {
    const char *word;
    double value;
};

struct kiln_option {
    const char *name;   /* such as "samples-direct": the key in a job file and, after "--", the option */
    const char *former; /* the name it had in the version before, which is still accepted; NULL: none */
    /* the option after whose value and a colon this one's value stands: --undersample mipmap:4. Its own name comes from
     * the version before and is still accepted; NULL: the option stands alone */
    const char *second_of;
    const char *group; /* heading in --help */
    enum kiln_option_kind kind;
    const char *value;       /* placeholder in --help, names the unit: "METRES"; NULL for flags and choices */
    const char *fallback;    /* the default, parsed like a given value; NULL: zero */
    const char *shown;       /* the default as --help shows it; NULL: `fallback` */
    double minimum, maximum; /* of numbers, both inclusive */
    const char *word;        /* accepted in place of a number; NULL: none */
    double word_value;       /* the number that the word stands for */
    const char *other_word;  /* likewise; NULL: there is no second one */
    double other_value;
    const struct kiln_option_word *words; /* more words, of KILN_OPTION_DOUBLE; ends with a NULL word; NULL: none */
    bool may_be_infinite;                 /* of KILN_OPTION_DOUBLE: accepts "inf" */
    const char *const *choices;           /* ends with NULL */
    bool percentage;                      /* of choices: also a number from minimum to maximum with a % sign */
    int refusal;       /* status of an unknown choice; 0: KILN_USAGE, or KILN_BAD_INPUT in a job file */
    const char *help;  /* one line */
    uint32_t commands; /* the commands that have the option: enum kiln_command_bit, or-ed */
    uint32_t common; /* subset of `commands`: their first screen of help shows the option, the others only --help all */
    const struct kiln_condition *when; /* condition under which it has effect (conditions.h); NULL: always */
    /* the option determines the light, or which of its results are written to the folder that the user names: kiln
     * relight reads it from a bake's folder, which anybody may have written. So it must write nowhere else and run
     * nothing */
    bool of_light;
    size_t offset; /* of its member in struct kiln_job */
};

extern const struct kiln_option kiln_options[];
extern const size_t kiln_option_count;

/* A preset of --quality: an error of published light, and the sample counts of bakes that no error can end (job.h:
 * kiln_job_light.counted_for). */
struct kiln_quality {
    const char *name;
    double error;    /* %; with --quality N% all else is that of the coarsest preset with no more error */
    uint32_t texels; /* of the scene with automatic density */
    uint32_t samples_direct, samples_bounce, samples_indirect, samples_probe;
};
extern const struct kiln_quality kiln_qualities[];
extern const size_t kiln_quality_count;

struct kiln_command {
    const char *name;
    uint32_t bit;
    const char *arguments;    /* as shown in usage lines: "SCENE|JOB.yaml" */
    const char *words;        /* what the first argument may be, with blanks between; NULL: it is no word of a list */
    size_t minimum, maximum;  /* number of arguments */
    bool scene;               /* the first argument is a scene or a job file */
    bool folder;              /* the first argument is the folder of a bake */
    bool mpi;                 /* runs between MPI_Init and MPI_Finalize */
    const char *summary;      /* one line */
    const char *output;       /* what --output names, and its default; NULL: the command has no such option */
    const char *examples[12]; /* command lines; ends with NULL */
};
extern const struct kiln_command kiln_commands[];
extern const size_t kiln_command_count;

/* The option with that name, present or former. NULL when there is none. */
const struct kiln_option *kiln_option_find(const char *name);
/* Likewise; if several options have that name, finds the one of one of `commands`. --partition is the unit of work of
 * bake and the Slurm partition of submit; --ranks is a number for plan and a list for bench. */
const struct kiln_option *kiln_option_find_for(const char *name, uint32_t commands);
const struct kiln_command *kiln_command_find(const char *name);

/* Returns the option whose value follows that of `option` and a colon; NULL: there is none. */
const struct kiln_option *kiln_option_second(const struct kiln_option *option);

/* Optimal string alignment distance: the number of insertions, deletions, substitutions and swaps of neighbouring
 * characters that turn `a` into `b`. */
size_t kiln_edit_distance(const char *a, const char *b);

/* Whether `name` may be a misspelling of `known`: the edit distance is less than a third of the longer name, or `name`
 * is its beginning, of at least three letters. */
bool kiln_is_near(const char *name, const char *known);

/* The known name that kiln_is_near accepts and that has the least edit distance from `name`; the first of several; NULL
 * if there is none. Of options, only those of one of `commands` that stand alone are considered. */
const char *kiln_option_nearest(const char *name, uint32_t commands);
const char *kiln_command_nearest(const char *name);

/* Returns KILN_USAGE with the message about an unknown command. */
int kiln_command_unknown(const char *name, struct kiln_error *error);

/* The default of an option as messages and --help show it; "" if it is not worth showing. */
const char *kiln_option_default(const struct kiln_option *option);

/* Parses `text` strictly (no trailing characters, no NaN, within the range) and stores the value in the job. `where` is
 * the place for messages ("--threads", "job.yaml:3: threads"); `status` is the code for a refused value. Strings are
 * copied and owned by the job. Relative paths get `folder` in front unless it is NULL. */
int kiln_option_set(struct kiln_job *job, const struct kiln_option *option, const char *text, const char *where,
                    int status, const char *folder, struct kiln_error *error);

/* Parses a number with a % sign. */
bool kiln_option_percentage(const char *text, double *percent);
/* Reads the text of a KILN_OPTION_BOX. */
bool kiln_option_box(const char *text, double box[6]);

/* The value of an option in the job, as text that could be given for it. The text is owned by the job, static, or
 * written to `room`. */
enum { KILN_OPTION_TEXT = 64 };
const char *kiln_option_text(const struct kiln_job *job, const struct kiln_option *option, char room[KILN_OPTION_TEXT]);

/* Text of an option as on the command line: with its second value, "mipmap:4", if that was given. */
const char *kiln_option_argument(const struct kiln_job *job, const struct kiln_option *option,
                                 char room[KILN_OPTION_TEXT]);

/* Whether the option was given after another's value and a colon, not by its own name. */
bool kiln_option_behind(const struct kiln_job *job, const struct kiln_option *option);

/* Prints the screen of `kiln help` (`command` NULL), or of `kiln COMMAND --help`: the common options, with `all` every
 * option. Lines are as long as the terminal is wide. */
void kiln_help(FILE *stream, const struct kiln_command *command, bool all);

#endif
