/* Studies: the benches that are Python scripts (jobs/studies/NAME.py). They run kiln many times, read its JSON and draw
 * figures. */
#ifndef KILN_COORDINATOR_CLI_STUDIES_H
#define KILN_COORDINATOR_CLI_STUDIES_H

#include <stdbool.h>

#include "worker/base/status.h"

/* Whether the command line is `kiln bench NAME ...` and NAME is that of a study: lower-case words joined by '-', and no
 * bench of the program itself. */
bool kiln_study_is_asked_for(int argc, char **argv);

/* Runs Python with the study's script and the arguments after NAME, passes signals on to it, and ends this process as
 * Python ends; KILN in Python's environment is the path of this program. The folder of scripts is the first existing
 * one of: $KILN_STUDIES; the source's jobs/studies, for a program in its build folder; ../share/kiln/studies beside the
 * program's folder. Python is $KILN_PYTHON, or python3 in PATH. Returns only after a failure: KILN_USAGE if no study
 * has that name, KILN_SITE if the folder or Python is missing. */
int kiln_study_start(int argc, char **argv, struct kiln_error *error);

/* Callback that receives a study's name and the first sentence of its script. */
typedef void (*kiln_study_tell)(void *context, const char *name, const char *sentence);
/* Calls `tell` for each study, by name. KILN_SITE if their folder is missing. */
int kiln_studies_list(kiln_study_tell tell, void *context, struct kiln_error *error);

#endif
