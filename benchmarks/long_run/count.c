/* A plugin of QEMU's user emulators that counts the instructions between the functions step_begins and step_ends.
 *
 * When the program ends it prints, for each time that it went from the one to the other, "INSTRUCTIONS TIMES": how many
 * steps took so many. What is declared here is the part of QEMU's plugin interface, version 1, that is called.
 */
#include <inttypes.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#define EXPORTED __attribute__((visibility("default")))
#define ADD 0
#define NO_REGISTERS 0
#define MOST (1u << 22)

typedef uint64_t plugin;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *block);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *block, size_t which);
const char *qemu_plugin_insn_symbol(const struct qemu_plugin_insn *instruction);
void qemu_plugin_register_vcpu_tb_trans_cb(plugin own, void (*seen)(plugin, struct qemu_plugin_tb *));
void qemu_plugin_register_vcpu_tb_exec_inline(struct qemu_plugin_tb *block, int what, void *number, uint64_t by);
void qemu_plugin_register_vcpu_tb_exec_cb(
    struct qemu_plugin_tb *block, void (*done)(unsigned, void *), int flags, void *given);
void qemu_plugin_register_atexit_cb(plugin own, void (*ended)(plugin, void *), void *given);

EXPORTED int qemu_plugin_version = 1;

static uint64_t counted;
static uint64_t before;
static uint32_t times[MOST];

static void begins(unsigned processor, void *given)
{
    (void)processor;
    (void)given;
    before = counted;
}

static void ends(unsigned processor, void *given)
{
    const uint64_t number = counted - before;
    (void)processor;
    (void)given;
    ++times[number < MOST ? number : MOST - 1];
}

static void seen(plugin own, struct qemu_plugin_tb *block)
{
    const char *name = qemu_plugin_insn_symbol(qemu_plugin_tb_get_insn(block, 0));
    (void)own;
    qemu_plugin_register_vcpu_tb_exec_inline(block, ADD, &counted, qemu_plugin_tb_n_insns(block));
    if (name != NULL && strcmp(name, "step_begins") == 0) {
        qemu_plugin_register_vcpu_tb_exec_cb(block, begins, NO_REGISTERS, NULL);
    }
    if (name != NULL && strcmp(name, "step_ends") == 0) {
        qemu_plugin_register_vcpu_tb_exec_cb(block, ends, NO_REGISTERS, NULL);
    }
}

static void ended(plugin own, void *given)
{
    uint32_t k;
    (void)own;
    (void)given;
    for (k = 0; k < MOST; ++k) {
        if (times[k] > 0) {
            (void)fprintf(stderr, "%" PRIu32 " %" PRIu32 "\n", k, times[k]);
        }
    }
}

EXPORTED int qemu_plugin_install(plugin own, const void *about, int count, char **arguments)
{
    (void)about;
    (void)count;
    (void)arguments;
    qemu_plugin_register_vcpu_tb_trans_cb(own, seen);
    qemu_plugin_register_atexit_cb(own, ended, NULL);
    return 0;
}
