/* Options and option values that were removed. A user who still gives one is told what to do instead. A checkpoint made
 * with such an option at its default can be resumed. */
#ifndef KILN_COORDINATOR_JOB_GONE_H
#define KILN_COORDINATOR_JOB_GONE_H

struct kiln_gone_option {
    const char *name;     /* without dashes */
    const char *value;    /* removed value; NULL: the whole option is removed */
    const char *fallback; /* the option's default, as it was written; NULL with a value */
    const char *since;    /* the first version without it */
    const char *instead;  /* end of a sentence: what to do instead */
};

/* Finds a removed option. NULL: there never was one of that name, or it still exists (kiln_option_find). */
const struct kiln_gone_option *kiln_gone_option_find(const char *name);
/* Finds a removed value of an option that still exists. */
const struct kiln_gone_option *kiln_gone_value_find(const char *name, const char *value);

#endif
