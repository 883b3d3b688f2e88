/* Text about an option, for --help and the manual page. */
#ifndef KILN_COORDINATOR_CLI_HELP_TEXT_H
#define KILN_COORDINATOR_CLI_HELP_TEXT_H

#include "coordinator/job/options.h"

enum { KILN_HELP_HEAD = 160, KILN_HELP_SENTENCE = 400 };

/* An option with its values: "--bounces N|all", "--half", "--undersample none|stride|random|mipmap[:W]". */
void kiln_help_head(const struct kiln_option *option, char text[KILN_HELP_HEAD]);

/* Writes the option's sentence and its defaults. `command`: the command whose --output is meant; NULL: any command. */
void kiln_help_sentence(const struct kiln_option *option, const struct kiln_command *command,
                        char text[KILN_HELP_SENTENCE]);

/* Whether the help of a command lists the option: the option belongs to the command and is not part of another. With
 * `all` unset, whether its first screen does: that lists common options, or all if the command marks none as common. */
bool kiln_help_has(const struct kiln_command *command, const struct kiln_option *option, bool all);

/* `kiln --completion bash`: a script for the shell, which completes commands, options and values. */
void kiln_completion_print(FILE *stream);

/* `kiln --man`: the manual page, as roff. */
void kiln_man_print(FILE *stream);

#endif
