#include "coordinator/job/gone.h"

#include <stddef.h>
#include <string.h>

#include "coordinator/job/options.h"

#define NO_BETTER "it was never found better than balance: give --mis balance, or leave --mis out"

static const struct kiln_gone_option gone[] = {
    {"connections", NULL, "0", "0.2.0", "leave it out: more light paths (--photons) lower the noise more"},
    {"traversal", NULL, "auto", "0.2.0", "leave it out: kiln measures the ways of a GPU, and takes the quicker one"},
    {"dispatch-time", NULL, "100", "0.2.0", "leave it out: kiln gives a GPU work of a tenth of a second at a time"},
    {"exchange-limit", NULL, "auto", "0.2.0", "leave it out: kiln divides messages that MPI cannot count"},
    {"mis", "variance", NULL, "0.2.0", NO_BETTER},
    {"mis", "correlation", NULL, "0.2.0", NO_BETTER},
    {"mis", "optimal", NULL, "0.2.0", NO_BETTER}};

const struct kiln_gone_option *kiln_gone_option_find(const char *name)
{
    for (size_t i = 0; i < sizeof gone / sizeof *gone; i++)
        if (gone[i].value == NULL && strcmp(gone[i].name, name) == 0)
            return kiln_option_find(name) == NULL ? &gone[i] : NULL;
    return NULL;
}

const struct kiln_gone_option *kiln_gone_value_find(const char *name, const char *value)
{
    for (size_t i = 0; i < sizeof gone / sizeof *gone; i++)
        if (gone[i].value != NULL && strcmp(gone[i].name, name) == 0 && strcmp(gone[i].value, value) == 0)
            return &gone[i];
    return NULL;
}
