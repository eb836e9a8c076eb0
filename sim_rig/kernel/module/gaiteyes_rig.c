// SPDX-License-Identifier: GPL-2.0-only
/*
 * An I2C adapter and a GPIO chip that a program in user space answers, for testing drivers on a real kernel.
 *
 * Kernel modules are derived from the kernel: this file is under the GNU General Public License, version 2,
 * unlike the rest of the project. Nothing of the project is linked with it; it is loaded in test machines only.
 *
 * /dev/gaiteyes-rig, all integers in the machine's byte order:
 *   read   one transfer: { u32 id, u32 messages }, then per message { u16 address, u16 flags, u16 length, u16 0 }
 *          and, unless I2C_M_RD is set, its data. Waits for one (EAGAIN if non-blocking; poll tells).
 *   write  { u32 0, u32 id, s32 error } and the data of all messages to read, if error is 0: ends the transfer;
 *          { u32 1, u32 line, s32 level }: sets an input line of the GPIO chip, whose edges interrupt.
 *
 * Without a program a transfer fails with ENXIO, as on a bus without chips. Unanswered for a second, the adapter's
 * timeout, it fails with ETIMEDOUT; a late answer is refused with ESTALE.
 */

#include <linux/completion.h>
#include <linux/fs.h>
#include <linux/gpio/driver.h>
#include <linux/i2c.h>
#include <linux/irq.h>
#include <linux/irqdomain.h>
#include <linux/miscdevice.h>
#include <linux/module.h>
#include <linux/mutex.h>
#include <linux/poll.h>
#include <linux/uaccess.h>
#include <linux/wait.h>

#define NAME "gaiteyes-rig"
#define LINES 4

enum { ANSWER, LEVEL };

struct request_head {
	u32 id;
	u32 messages;
};

struct message_head {
	u16 address;
	u16 flags;
	u16 length;
	u16 reserved;
};

struct command {
	u32 kind;
	u32 number;
	s32 value;
};

/* The transfer under way; `lock` guards all of it but the completion. */
static DEFINE_MUTEX(lock);
static DECLARE_COMPLETION(answered);
static DECLARE_WAIT_QUEUE_HEAD(asked);
static struct i2c_msg *messages;
static u32 message_count;
static u32 request_id;
static bool waiting; /* to be read */
static int result;
static bool served;

static unsigned long levels, unmasked;
static unsigned int edge_types[LINES];

static int rig_transfer(struct i2c_adapter *adapter, struct i2c_msg *msgs, int count)
{
	int done;

	mutex_lock(&lock);
	if (!served) {
		mutex_unlock(&lock);
		return -ENXIO;
	}
	messages = msgs;
	message_count = count;
	request_id++;
	waiting = true;
	result = -ETIMEDOUT;
	reinit_completion(&answered);
	mutex_unlock(&lock);

	wake_up_interruptible(&asked);
	wait_for_completion_killable_timeout(&answered, adapter->timeout);

	mutex_lock(&lock);
	messages = NULL;
	waiting = false;
	done = result;
	mutex_unlock(&lock);
	return done ? done : count;
}

static u32 rig_functionality(struct i2c_adapter *adapter)
{
	return I2C_FUNC_I2C | I2C_FUNC_SMBUS_EMUL;
}

static const struct i2c_algorithm rig_algorithm = {
	.master_xfer = rig_transfer,
	.functionality = rig_functionality,
};

static struct i2c_adapter rig_adapter = {
	.owner = THIS_MODULE,
	.name = NAME,
	.algo = &rig_algorithm,
	.timeout = HZ,
};

static int rig_get_direction(struct gpio_chip *chip, unsigned int line)
{
	return GPIO_LINE_DIRECTION_IN;
}

static int rig_direction_input(struct gpio_chip *chip, unsigned int line)
{
	return 0;
}

static int rig_get(struct gpio_chip *chip, unsigned int line)
{
	return test_bit(line, &levels);
}

static void rig_irq_mask(struct irq_data *data)
{
	clear_bit(irqd_to_hwirq(data), &unmasked);
	gpiochip_disable_irq(irq_data_get_irq_chip_data(data), irqd_to_hwirq(data));
}

static void rig_irq_unmask(struct irq_data *data)
{
	gpiochip_enable_irq(irq_data_get_irq_chip_data(data), irqd_to_hwirq(data));
	set_bit(irqd_to_hwirq(data), &unmasked);
}

static int rig_irq_set_type(struct irq_data *data, unsigned int type)
{
	edge_types[irqd_to_hwirq(data)] = type;
	return 0;
}

static const struct irq_chip rig_irq_chip = {
	.name = NAME,
	.irq_mask = rig_irq_mask,
	.irq_unmask = rig_irq_unmask,
	.irq_set_type = rig_irq_set_type,
	.flags = IRQCHIP_IMMUTABLE,
	GPIOCHIP_IRQ_RESOURCE_HELPERS,
};

static struct gpio_chip rig_gpio = {
	.label = NAME,
	.owner = THIS_MODULE,
	.base = -1,
	.ngpio = LINES,
	.get_direction = rig_get_direction,
	.direction_input = rig_direction_input,
	.get = rig_get,
};

static int rig_set_level(u32 line, bool high)
{
	unsigned int edge = high ? IRQ_TYPE_EDGE_RISING : IRQ_TYPE_EDGE_FALLING;
	unsigned long flags;

	if (line >= LINES)
		return -EINVAL;
	if (test_bit(line, &levels) == high)
		return 0;
	assign_bit(line, &levels, high);
	if (test_bit(line, &unmasked) && edge_types[line] & edge) {
		local_irq_save(flags); /* as an interrupt handler finds it */
		generic_handle_domain_irq(rig_gpio.irq.domain, line);
		local_irq_restore(flags);
	}
	return 0;
}

static int rig_answer(u32 id, int error, const char __user *data, size_t length)
{
	u32 i;

	if (!messages || id != request_id)
		return -ESTALE;
	for (i = 0; i < message_count && !error; i++) {
		if (!(messages[i].flags & I2C_M_RD))
			continue;
		if (length < messages[i].len)
			return -EINVAL;
		if (copy_from_user(messages[i].buf, data, messages[i].len))
			return -EFAULT;
		data += messages[i].len;
		length -= messages[i].len;
	}
	result = -error;
	complete(&answered);
	return 0;
}

static ssize_t rig_write(struct file *file, const char __user *data, size_t length, loff_t *position)
{
	struct command command;
	int error;

	if (length < sizeof(command))
		return -EINVAL;
	if (copy_from_user(&command, data, sizeof(command)))
		return -EFAULT;
	switch (command.kind) {
	case ANSWER:
		if (command.value < 0 || command.value > MAX_ERRNO)
			return -EINVAL;
		mutex_lock(&lock);
		error = rig_answer(command.number, command.value, data + sizeof(command), length - sizeof(command));
		mutex_unlock(&lock);
		break;
	case LEVEL:
		error = rig_set_level(command.number, command.value);
		break;
	default:
		error = -EINVAL;
	}
	return error ? error : length;
}

/* Copies out the waiting transfer; called with the lock held. */
static ssize_t rig_copy_request(char __user *data, size_t length)
{
	struct request_head head = { .id = request_id, .messages = message_count };
	size_t used = sizeof(head);
	u32 i;

	if (length < used)
		return -EMSGSIZE;
	if (copy_to_user(data, &head, sizeof(head)))
		return -EFAULT;
	for (i = 0; i < message_count; i++) {
		struct message_head message = {
			.address = messages[i].addr, .flags = messages[i].flags, .length = messages[i].len
		};
		size_t written = messages[i].flags & I2C_M_RD ? 0 : messages[i].len;

		if (length - used < sizeof(message) + written)
			return -EMSGSIZE;
		if (copy_to_user(data + used, &message, sizeof(message)) ||
		    copy_to_user(data + used + sizeof(message), messages[i].buf, written))
			return -EFAULT;
		used += sizeof(message) + written;
	}
	waiting = false;
	return used;
}

static ssize_t rig_read(struct file *file, char __user *data, size_t length, loff_t *position)
{
	ssize_t used = -EAGAIN;

	for (;;) {
		mutex_lock(&lock);
		if (waiting)
			used = rig_copy_request(data, length);
		mutex_unlock(&lock);
		if (used != -EAGAIN || file->f_flags & O_NONBLOCK)
			return used;
		if (wait_event_interruptible(asked, READ_ONCE(waiting)))
			return -ERESTARTSYS;
	}
}

static __poll_t rig_poll(struct file *file, poll_table *table)
{
	poll_wait(file, &asked, table);
	return READ_ONCE(waiting) ? EPOLLIN | EPOLLRDNORM | EPOLLOUT : EPOLLOUT;
}

static int rig_open(struct inode *inode, struct file *file)
{
	int error = 0;

	mutex_lock(&lock);
	if (served)
		error = -EBUSY;
	else
		served = true;
	mutex_unlock(&lock);
	return error;
}

static int rig_release(struct inode *inode, struct file *file)
{
	mutex_lock(&lock);
	served = false;
	if (messages) {
		result = -ENXIO;
		complete(&answered);
	}
	mutex_unlock(&lock);
	return 0;
}

static const struct file_operations rig_operations = {
	.owner = THIS_MODULE,
	.open = rig_open,
	.release = rig_release,
	.read = rig_read,
	.write = rig_write,
	.poll = rig_poll,
	.llseek = no_llseek,
};

static struct miscdevice rig_device = {
	.minor = MISC_DYNAMIC_MINOR,
	.name = NAME,
	.fops = &rig_operations,
};

static int __init rig_init(void)
{
	struct gpio_irq_chip *irq = &rig_gpio.irq;
	int error = misc_register(&rig_device);

	if (error)
		return error;
	rig_adapter.dev.parent = rig_device.this_device;
	rig_gpio.parent = rig_device.this_device;
	gpio_irq_chip_set_chip(irq, &rig_irq_chip);
	irq->handler = handle_simple_irq;
	irq->default_type = IRQ_TYPE_NONE;
	error = gpiochip_add_data(&rig_gpio, NULL);
	if (error)
		goto no_gpio;
	error = i2c_add_adapter(&rig_adapter);
	if (error)
		goto no_adapter;
	return 0;

no_adapter:
	gpiochip_remove(&rig_gpio);
no_gpio:
	misc_deregister(&rig_device);
	return error;
}

static void __exit rig_exit(void)
{
	i2c_del_adapter(&rig_adapter);
	gpiochip_remove(&rig_gpio);
	misc_deregister(&rig_device);
}

module_init(rig_init);
module_exit(rig_exit);
MODULE_DESCRIPTION("I2C adapter and GPIO chip answered from user space, for driver tests");
MODULE_AUTHOR("GaitEyes");
MODULE_LICENSE("GPL");
