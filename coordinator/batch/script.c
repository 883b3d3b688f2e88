#include <ctype.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "coordinator/batch/batch.h"

static bool is_plain(unsigned char c) { return isalnum(c) || strchr("%+,-./:=@_", c) != NULL; }

void kiln_batch_quote(FILE *stream, const char *text)
{
    /* inside $'...' only the characters escaped here are special */
    bool plain = text[0] != '\0', escaped = false;
    for (const char *at = text; *at != '\0'; at++) {
        plain = plain && is_plain((unsigned char)*at);
        escaped = escaped || iscntrl((unsigned char)*at) || strchr("$`\\'", *at) != NULL;
    }
    if (plain) {
        (void)fputs(text, stream);
        return;
    }
    (void)fputs(escaped ? "$'" : "'", stream);
    for (const char *at = text; *at != '\0'; at++) {
        if (iscntrl((unsigned char)*at))
            (void)fprintf(stream, "\\%03o", (unsigned)(unsigned char)*at);
        else if (*at == '\'' || *at == '\\')
            (void)fprintf(stream, "\\%c", *at);
        else
            (void)fputc(*at, stream);
    }
    (void)fputc('\'', stream);
}

static void assign(FILE *stream, const char *name, const char *text)
{
    (void)fprintf(stream, "%s=", name);
    kiln_batch_quote(stream, text);
    (void)fputc('\n', stream);
}

/* ---- what Slurm reads ---- */

static int check_word(const char *text, const char *allowed, const char *option, const char *remedy,
                      struct kiln_error *error)
{
    if (text == NULL)
        return KILN_OK;
    bool good = text[0] != '\0' && text[0] != '-';
    for (const char *at = text; *at != '\0'; at++)
        good = good && (isalnum((unsigned char)*at) || strchr(allowed, *at) != NULL);
    return good ? KILN_OK
                : kiln_fail(error, KILN_USAGE, "--%s: '%.200s' is not a name that Slurm accepts; %s", option, text,
                            remedy);
}

static int check(const struct kiln_batch_job *batch, struct kiln_error *error)
{
    int status;
    KILN_TRY(check_word(batch->partition, "_-.,", "partition", "sinfo lists the partitions", error));
    KILN_TRY(check_word(batch->account, "_-.", "account", "sacctmgr lists the accounts", error));
    if (batch->time != NULL && batch->time[strspn(batch->time, "0123456789:-")] != '\0')
        KILN_TRY(
            kiln_fail(error, KILN_USAGE,
                      "--time: '%.200s' is not in Slurm's notation; write MINUTES, HOURS:MINUTES:SECONDS or DAYS-HOURS",
                      batch->time));
end:
    return status != KILN_OK
               ? status
               : check_word(batch->time, ":-", "time", "write MINUTES, HOURS:MINUTES:SECONDS or DAYS-HOURS", error);
}

static bool tries_again(const struct kiln_batch_job *batch) { return batch->nodes > 1 && batch->tries > 1; }

/* Writes the job's name in the queue: letters and digits of the first bake's name. */
static void write_name(FILE *stream, const struct kiln_batch_job *batch)
{
    const char *slash = strrchr(batch->items[0].job, '/');
    const char *name = slash == NULL ? batch->items[0].job : slash + 1;
    const char *dot = strrchr(name, '.');
    const size_t length = dot == NULL || dot == name ? strlen(name) : (size_t)(dot - name);
    (void)fputs("#SBATCH --job-name=kiln-", stream);
    for (size_t i = 0; i < length && i < 40; i++)
        (void)fputc(isalnum((unsigned char)name[i]) ? name[i] : '-', stream);
    (void)fputc('\n', stream);
}

static void write_directives(FILE *stream, const struct kiln_batch_job *batch)
{
    (void)fputs("#!/bin/bash\n", stream);
    write_name(stream, batch);
    (void)fprintf(stream, "#SBATCH --nodes=%u\n#SBATCH --ntasks-per-node=%u\n", batch->nodes, batch->ranks_per_node);
    if (batch->threads > 0)
        (void)fprintf(stream, "#SBATCH --cpus-per-task=%u\n", batch->threads);
    else
        (void)fputs("#SBATCH --exclusive\n", stream);
    if (batch->gpus > 0)
        (void)fprintf(stream, "#SBATCH --gpus-per-node=%u\n", batch->gpus);
    if (batch->memory > 0)
        (void)fprintf(stream, "#SBATCH --mem=%.0fM\n", ceil(batch->memory * 1024));
    else if (batch->threads == 0)
        (void)fputs("#SBATCH --mem=0\n", stream); /* all memory of the node */
    if (batch->time != NULL)
        (void)fprintf(stream, "#SBATCH --time=%s\n", batch->time);
    if (batch->partition != NULL)
        (void)fprintf(stream, "#SBATCH --partition=%s\n", batch->partition);
    if (batch->account != NULL)
        (void)fprintf(stream, "#SBATCH --account=%s\n", batch->account);
    if (tries_again(batch))
        (void)fputs("#SBATCH --no-kill\n", stream);
    if (batch->item_count > 1)
        (void)fprintf(stream, "#SBATCH --array=0-%zu\n", batch->item_count - 1);
    (void)fprintf(
        stream,
        "#SBATCH --signal=B:USR1@%u\n#SBATCH --requeue\n#SBATCH --open-mode=append\n#SBATCH --output=kiln-%s.log\n",
        batch->warning, batch->item_count > 1 ? "%A_%a" : "%j");
}

/* ---- what the shell reads ---- */

static void write_list(FILE *stream, const char *name, const struct kiln_batch_job *batch, size_t offset)
{
    (void)fprintf(stream, "%s=(\n", name);
    for (size_t i = 0; i < batch->item_count; i++) {
        (void)fputs("  ", stream);
        kiln_batch_quote(stream, *(const char *const *)((const char *)&batch->items[i] + offset));
        (void)fputc('\n', stream);
    }
    (void)fputs(")\n", stream);
}

static void write_names(FILE *stream, const struct kiln_batch_job *batch)
{
    (void)fprintf(stream, "\n# A bake by kiln " KILN_VERSION
                          ". The same script can be submitted again: it continues where the last run stopped.\n\n");
    assign(stream, "folder", batch->folder);
    assign(stream, "kiln", batch->program);
    assign(stream, "mpirun", batch->mpirun);
    write_list(stream, "jobs", batch, offsetof(struct kiln_batch_item, job));
    write_list(stream, "outputs", batch, offsetof(struct kiln_batch_item, output));
    (void)fprintf(stream, "job=${jobs[${SLURM_ARRAY_TASK_ID:-0}]}\noutput=${outputs[${SLURM_ARRAY_TASK_ID:-0}]}\n"
                          "options=(--output \"$output\"");
    if (batch->threads > 0)
        (void)fprintf(stream, " --threads %u", batch->threads);
    if (batch->backend != NULL) {
        (void)fputs(" --backend ", stream);
        kiln_batch_quote(stream, batch->backend);
    }
    (void)fputs(")\n\ncd -- \"$folder\" || exit 73\n", stream);
    if (batch->setup != NULL) {
        (void)fputs("# shellcheck disable=SC1090,SC1091\n. ", stream);
        kiln_batch_quote(stream, batch->setup);
        (void)fputs(" || exit 78\n", stream);
    }
}

static const char settings[] =
    "\n"
    "# Do not bind each rank to one core. Notice a lost node or link after 14 s instead of minutes.\n"
    "export OMPI_MCA_hwloc_base_binding_policy=none\n"
    "export OMPI_MCA_oob_tcp_keepalive_time=6 OMPI_MCA_oob_tcp_keepalive_intvl=2 OMPI_MCA_oob_tcp_keepalive_probes=4\n"
    "export OMP_WAIT_POLICY=passive\n";

static const char work[] =
    "\n"
    "newest() { # prints the manifest of the newest checkpoint\n"
    "  local all=(\"$output\"/checkpoint/gen-*/manifest)\n"
    "  printf '%s\\n' \"${all[${#all[@]}-1]}\"\n"
    "}\n"
    "before=$(newest)\n"
    "attempt=${SLURM_RESTART_COUNT:-0}\n"
    "echo \"kiln: job $SLURM_JOB_ID, attempt $((attempt + 1)), on $SLURM_JOB_NODELIST\"\n"
    "\n"
    "# The time limit is near, or the job is preempted: ask the ranks to save a checkpoint and exit.\n"
    "told=no\n"
    "# shellcheck disable=SC2317 # the trap calls it\n"
    "tell() {\n"
    "  told=yes\n"
    "  [ -n \"${bake:-}\" ] || return 0\n"
    "  # more than once: what mpirun hears before the ranks have started is lost\n"
    "  while kill -USR1 \"$bake\" 2>/dev/null; do sleep 5; done &\n"
    "}\n"
    "trap tell USR1 TERM\n";

static const char wait_for_it[] =
    "  bake=$!\n"
    "  [ $told = no ] || tell\n"
    "  wait \"$bake\"\n"
    "  status=$?\n"
    "  while kill -0 \"$bake\" 2>/dev/null; do # a signal interrupts `wait`, not the bake\n"
    "    wait \"$bake\"\n"
    "    status=$?\n"
    "  done\n"
    "  bake=\n"
    "}\n";

/* A rank that died on a node that still answers might die there again: then the script ends and the queue tries
 * again. */
static const char leave_out[] =
    "\n"
    "# Leave a lost node out of the next try, and out of all later ones when it is lost again.\n"
    "mapfile -t nodes < <(scontrol show hostnames \"$SLURM_JOB_NODELIST\")\n"
    "used=(\"${nodes[@]}\")\n"
    "declare -A losses\n"
    "leave_out_the_lost() { # fails when all nodes in use answer, or none does\n"
    "  local node answers lost=() left=()\n"
    "  answers=$(for node in \"${nodes[@]}\"; do\n"
    "    timeout 8 srun --overlap --nodes=1 --ntasks=1 --nodelist=\"$node\" echo \"$node\" </dev/null 2>/dev/null &\n"
    "  done; wait)\n"
    "  for node in \"${used[@]}\"; do\n"
    "    if ! grep -qxF -e \"$node\" <<<\"$answers\"; then\n"
    "      losses[$node]=$((${losses[$node]:-0} + 1))\n"
    "      lost+=(\"$node\")\n"
    "    fi\n"
    "  done\n"
    "  for node in \"${nodes[@]}\"; do\n"
    "    if [ \"${losses[$node]:-0}\" -lt 2 ] && grep -qxF -e \"$node\" <<<\"$answers\"; then\n"
    "      left+=(\"$node\")\n"
    "    fi\n"
    "  done\n"
    "  if [ ${#lost[@]} = 0 ] || [ ${#left[@]} = 0 ]; then\n"
    "    return 1\n"
    "  fi\n"
    "  used=(\"${left[@]}\")\n"
    "  where=(--host \"$(IFS=,; echo \"${used[*]/%/:$ranks}\")\")\n"
    "  echo \"kiln: no answer from ${lost[*]} (exit $status); continuing on ${used[*]}\"\n"
    "}\n"
    "\n"
    "run\n"
    "for ((try = 2; try <= tries; try++)); do\n"
    "  case $status in\n"
    "    0 | 64 | 65 | 66 | 69 | 7[0134578]) break ;;\n"
    "  esac\n"
    "  if [ $told = yes ] || ! leave_out_the_lost || [ $told = yes ]; then\n"
    "    break\n"
    "  fi\n"
    "  run\n"
    "done\n"
    "if [ \"$status\" = 71 ] && [ ${#where[@]} -gt 0 ]; then\n"
    "  status=76 # out of memory on fewer nodes: all nodes together may have enough\n"
    "fi\n";

static const char judge[] =
    "\n"
    "again=no\n"
    "case $status in\n"
    "  0) ;;\n"
    "  64 | 65 | 66 | 69 | 70 | 71 | 73 | 74 | 77 | 78)\n"
    "    echo \"kiln: not requeued: it would fail again (exit $status)\" ;;\n"
    "  75) # stopped with a checkpoint\n"
    "    if [ $told = yes ]; then\n"
    "      again=yes\n"
    "    else\n"
    "      echo \"kiln: stopped on request; to continue: scontrol requeue $SLURM_JOB_ID\"\n"
    "    fi ;;\n"
    "  *) # a rank or a node was lost\n"
    "    if [ \"$attempt\" -lt 3 ] || [ \"$(newest)\" != \"$before\" ]; then\n"
    "      again=yes\n"
    "    else\n"
    "      echo \"kiln: not requeued: attempt $((attempt + 1)) ended (exit $status) without a new checkpoint\"\n"
    "    fi ;;\n"
    "esac\n"
    "if [ $again = yes ]; then\n"
    "  echo \"kiln: requeued (exit $status)\"\n"
    "  scontrol requeue \"$SLURM_JOB_ID\" || echo \"kiln: scontrol requeue failed; submit the script again to "
    "continue\"\n"
    "fi\n"
    "exit \"$status\"\n";

static void write_run(FILE *stream, const struct kiln_batch_job *batch)
{
    if (tries_again(batch))
        (void)fprintf(
            stream,
            "\nranks=%u # per node\ntries=%u # in this allocation\nwhere=() # mpirun's choice of nodes; empty: all\n",
            batch->ranks_per_node, batch->tries);
    (void)fprintf(stream,
                  "\nrun() {\n  \"$mpirun\" %s--map-by ppr:%u:node \"$kiln\" bake \"${options[@]}\" -- \"$job\" &\n",
                  tries_again(batch) ? "\"${where[@]}\" " : "", batch->ranks_per_node);
    (void)fputs(wait_for_it, stream);
    (void)fputs(tries_again(batch) ? leave_out : "\nrun\n", stream);
}

int kiln_batch_write(FILE *stream, const struct kiln_batch_job *batch, struct kiln_error *error)
{
    const int status = check(batch, error);
    if (status != KILN_OK)
        return status;
    write_directives(stream, batch);
    write_names(stream, batch);
    (void)fputs(settings, stream);
    (void)fputs(work, stream);
    write_run(stream, batch);
    (void)fputs(judge, stream);
    return ferror(stream) == 0 ? KILN_OK : kiln_fail(error, KILN_IO, "cannot write the batch script");
}
