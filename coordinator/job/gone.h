/* Options, and values of options, that earlier versions had. Whoever still gives one is told what to do. A checkpoint
 * that was made with such an option at its default goes on. */
#ifndef KILN_COORDINATOR_JOB_GONE_H
#define KILN_COORDINATOR_JOB_GONE_H

struct kiln_gone_option {
    const char *name;     /* without dashes */
    const char *value;    /* that is gone; NULL: the whole option is */
    const char *fallback; /* the option's default, as it was written; NULL with a value */
    const char *since;    /* the first version without it */
    const char *instead;  /* what to do: ends a sentence */
};

/* NULL: there never was such an option, or it is still there under that name (kiln_option_find). */
const struct kiln_gone_option *kiln_gone_option_find(const char *name);
/* The same of a value of an option that is still there. */
const struct kiln_gone_option *kiln_gone_value_find(const char *name, const char *value);

#endif
