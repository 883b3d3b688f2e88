/* Words about an option, as --help and the manual page have them. */
#ifndef KILN_COORDINATOR_CLI_HELP_TEXT_H
#define KILN_COORDINATOR_CLI_HELP_TEXT_H

#include "coordinator/job/options.h"

enum { KILN_HELP_HEAD = 160, KILN_HELP_SENTENCE = 400 };

/* An option with its values: "--bounces N|all", "--half", "--undersample none|stride|random|mipmap[:W]". */
void kiln_help_head(const struct kiln_option *option, char text[KILN_HELP_HEAD]);

/* The option's sentence, and its defaults. `command`: the one whose --output is meant; NULL: that of any. */
void kiln_help_sentence(const struct kiln_option *option, const struct kiln_command *command,
                        char text[KILN_HELP_SENTENCE]);

/* Whether a command's screens have the option: it is the command's, and stands alone. With `all` unset only the first
 * screen, which has all of them where none of the command's options is said to be common. */
bool kiln_help_has(const struct kiln_command *command, const struct kiln_option *option, bool all);

/* `kiln --completion bash`: a script for the shell, which completes commands, options and values. */
void kiln_completion_print(FILE *stream);

/* `kiln --man`: the manual page, as roff. */
void kiln_man_print(FILE *stream);

#endif
